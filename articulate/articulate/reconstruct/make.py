"""Make: question and parts in, a folder with a proven URDF out, and a page that tells how.

::

    Question + Given ─► Evidence ─► Actor ⇄ Critic ─► program ─► URDF ─► Proof ─► folder
"""

from __future__ import annotations

import json
import re
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from articulate.assets.check_report import CheckReport
from articulate.errors import ConfigError, UsageError, nearest
from articulate.files import copy_writable, write_json
from articulate.preparation.batch import Batch, Item
from articulate.preparation.store import check_out, hand_over
from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.protocol import (
    GOOD_ENOUGH,
    Actor,
    Evidence,
    PredictedJoint,
    Prediction,
)
from articulate.reconstruct.actors.registry import make_actor
from articulate.reconstruct.actors.vlm.dry_run import write_dry_run
from articulate.reconstruct.hinge_adjustment import Held, diagonal_of, relieved, told
from articulate.reconstruct.part_set import PartSet
from articulate.reconstruct.program.result import ProgramError
from articulate.reconstruct.program.run import compile_program
from articulate.reconstruct.program_writer import program_of, tree_of
from articulate.reconstruct.query import Query, foreground
from articulate.reconstruct.rerun_export import write_recording
from articulate.reconstruct.result import (
    MADE_FILE,
    PROGRAM_FOLDER,
    RECORDING_FILE,
    TRACE_FILE,
    MakeRecord,
    MakeRequest,
    MakeResult,
)
from articulate.reconstruct.text_counts import miscounted
from articulate.reconstruct.trace import write_trace
from articulate.render.camera import Camera
from articulate.render.scene import NOTHING, PartScene

ACTORS = {"video": "geometric-video", "image": "geometric-text", "text": "geometric-text"}
"""Who answers if nobody is named."""
TEXT_ACTOR = "geometric-text"
"""Who says the joints that a clip does not show."""
UNSURE = 0.35
"""A joint of which an actor is less sure makes the result doubtful."""
OVERLAP = 0.5
"""Less overlap of the picture's object with the parts, as the camera sees them, is doubtful."""


def make(question: Query, given: PartSet, camera: Camera, order: MakeRequest) -> MakeResult:
    """Find joints, write the program, prove what it describes, and write the folder.

    Nothing is written unless there is an object.

    Raises:
        UsageError: The question cannot be answered, or the folder cannot be written.
    """
    check_out(order.out)
    start = time.monotonic()
    _check_joint(order.joint, given)
    prediction, actor_name = _predicted(question, given, camera, order)
    said = time.monotonic()
    held: Held
    root, held = tree_of(_wanted(prediction.joints, order.joint), given.meshes)
    if all(joint.kind == "fixed" for joint in held.values()):
        raise UsageError(_nothing_moves(question, order.joint))
    own = prediction.program if _says_all(prediction, held) else ""
    bench = _Bench(given=given, order=order, actor=actor_name)
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        if own:
            check_report = bench.check_report(own, work)
        else:
            write = partial(program_of, root, actor=actor_name, question=question.told)
            eased, check_report = bench.eased(held, write, work)
            if eased is not held:
                prediction = replace(prediction, trace=(*prediction.trace, told(held, eased)))
                held = eased
        story = MakeRecord(
            given=given,
            question=question,
            camera=camera,
            actor=actor_name,
            prediction=prediction,
            root=root,
            held=held,
            program=own or write(held),
            layers=_layers(work / PROGRAM_FOLDER),
            seconds={"joints": said - start, **bench.seconds},
        )
        made = _judged(story, check_report, order, time.monotonic() - start)
        copy_writable(work / PROGRAM_FOLDER, work / "asset" / PROGRAM_FOLDER)
        made = _told(made, story, work / "asset")
        hand_over(work / "asset", order.out)
    return made


def dry_run(question: Query, given: PartSet, camera: Camera, order: MakeRequest, path: Path) -> int:
    """Write to the page ``path`` what a model would be asked; return how many questions.

    Raises:
        ConfigError: The actor asks no model.
    """
    evidence = _evidence(question, given, camera, order)
    told = f"{given.name}, {len(given.meshes)} parts, and {question.told}"
    return write_dry_run(_actor(order, question), evidence, path, told)


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """Makes an object of a program and proves it."""

    given: PartSet
    order: MakeRequest
    actor: str
    seconds: dict[str, float] = field(default_factory=lambda: {"program": 0.0, "proof": 0.0})

    def check_report(self, source: str, work: Path) -> CheckReport:
        """Check what is compiled, in a process of its own; the asset comes to lie in ``work``.

        Raises:
            UsageError: It cannot be compiled.
        """
        start = time.monotonic()
        urdf = compile_program(source, self.given.parts, work / PROGRAM_FOLDER)
        if isinstance(urdf, ProgramError):
            raise UsageError(f"the program of {self.actor} cannot be compiled: {urdf}")
        self.given.write_origin(work / PROGRAM_FOLDER)
        compiled = time.monotonic()
        order = self.order
        batch = Batch(
            out=work / "asset", cache=order.cache, options={}, limit_s=order.limit_s, single=True
        )
        check_report = batch.one(Item(name=urdf.stem, file=urdf)).check_report
        self.seconds["program"] += compiled - start
        self.seconds["proof"] += time.monotonic() - compiled
        return check_report

    def eased(
        self, held: Held, write: Callable[[Held], str], work: Path
    ) -> tuple[Held, CheckReport]:
        """``held``, moved within what a picture leaves open if it is refused as it was said."""
        check_report = self.check_report(write(held), work)
        if check_report.is_usable:
            return held, check_report
        size_m = diagonal_of(self.given.meshes)
        other = relieved(
            held, check_report, lambda h: self.check_report(write(h), work / "trial"), size_m
        )
        return (
            (held, check_report)
            if other is None
            else (other, self.check_report(write(other), work))
        )


def _says_all(prediction: Prediction, held: Mapping[str, PredictedJoint]) -> bool:
    """Whether an actor's own program says what is asked for, no more and no less."""
    said = {joint.part: joint.kind for joint in prediction.joints}
    return said == {part: joint.kind for part, joint in held.items()}


def _actor(order: MakeRequest, question: Query) -> Actor:
    """Who answers, with the number of turns that was asked for."""
    name = ACTORS[question.modality] if order.actor == "auto" else order.actor
    actor = make_actor(name)
    if order.iterations is not None and isinstance(actor, Loop):
        return replace(actor, max_iterations=order.iterations)
    return actor


def _evidence(question: Query, given: PartSet, camera: Camera, order: MakeRequest) -> Evidence:
    """What the actor is given."""
    return Evidence(
        modality=question.modality,
        parts=given.meshes,
        labels=given.labels,
        video=question.video,
        times_s=question.times_s,
        image=question.image,
        camera=None if question.modality == "text" else camera,
        text=f"{question.text} {given.kind}".strip(),
        seed=order.seed,
    )


def _predicted(
    question: Query, given: PartSet, camera: Camera, order: MakeRequest
) -> tuple[Prediction, str]:
    """What the actor says, and its name."""
    evidence = _evidence(question, given, camera, order)
    actor = _actor(order, question)
    prediction = actor.predict(evidence)
    name = ACTORS[question.modality] if order.actor == "auto" else order.actor
    if prediction.rejection:
        raise UsageError(f"{question.told}: {prediction.rejection}")
    if question.modality == "video" and order.joint == "all":
        rest = make_actor(TEXT_ACTOR).predict(replace(evidence, video=None, modality="text"))
        prediction = replace(prediction, joints=_with_unseen(prediction.joints, rest.joints))
        name = f"{name} and {TEXT_ACTOR}"
    return prediction, name


def _with_unseen(
    seen: Sequence[PredictedJoint], named: Sequence[PredictedJoint]
) -> tuple[PredictedJoint, ...]:
    """``seen`` in the clip, and what is ``named`` for parts that do not move in it.

    A knob that goes along with its door in the clip may turn on it all the same.
    """
    moved = {joint.part for joint in seen if joint.kind != "fixed"}
    along = {joint.part for joint in seen if joint.kind == "fixed"}
    more = [j for j in named if j.part not in (moved if j.kind != "fixed" else moved | along)]
    return (*seen, *more)


def _check_joint(wanted: str, given: PartSet) -> None:
    names = [mesh.name for mesh in given.meshes]
    if wanted not in {"auto", "all", *names}:
        raise ConfigError(
            f"--joint {wanted}: neither auto, nor all, nor a part{nearest(wanted, names)}"
        )


def _wanted(joints: Sequence[PredictedJoint], wanted: str) -> list[PredictedJoint]:
    """The joints that are asked for; what does not move is kept in any case."""
    if wanted in {"auto", "all"}:
        return list(joints)
    return [j for j in joints if j.part == wanted or j.kind == "fixed"]


def _nothing_moves(question: Query, wanted: str) -> str:
    if wanted not in {"auto", "all"}:
        return (
            f"{question.told} says nothing of a joint of {wanted}; give another --joint, or leave "
            "it out"
        )
    return (
        f"{question.told}: no joint was found; name parts by what they are (door, drawer, lid, "
        "handle …), or give a clip"
    )


def _judged(
    story: MakeRecord, check_report: CheckReport, order: MakeRequest, seconds: float
) -> MakeResult:
    """The verdict: what is not proven is unproven, what may be wrong doubtful."""
    doubts = _doubts(story)
    if not check_report.is_usable:
        lasting = [re.sub(r"\S*/(?=object\.urdf: )", "", reason) for reason in check_report.reasons]
        verdict, reasons = "unproven", [*lasting, *doubts]
    else:
        verdict, reasons = ("doubtful" if doubts else "passed"), doubts
    return MakeResult(
        verdict=verdict,  # type: ignore[arg-type]  # one of three literals
        reasons=tuple(reasons),
        out=order.out,
        joints=tuple(story.moving),
        check_report=check_report,
        rating=story.prediction.rating,
        seconds=seconds,
    )


def _doubts(story: MakeRecord) -> list[str]:
    """Why the object may not be the one that was meant."""
    verdict, question = story.prediction.verdict, story.question
    doubts = []
    if verdict is not None and not verdict.rating > GOOD_ENOUGH:
        what = verdict.failure.replace("_", " ")
        doubts.append(
            f"the critic rates it {verdict.rating:.1f} of 10 ({what}: {verdict.reason or 'no'})"
        )
    unsure = [j for j in story.moving if j.confidence < UNSURE]
    if unsure:
        told = ", ".join(f"{j.part} ({j.confidence:.2f})" for j in unsure)
        doubts.append(f"the actor is not sure of {told}")
    if question.text:
        doubts += miscounted(question.text, story.given.labels.values())
    if question.image is not None:
        share = overlap(question, story.given, story.camera)
        if share < OVERLAP:
            doubts.append(
                f"picture and parts overlap by {share:.0%}: another object, or another camera"
            )
    return doubts


def overlap(question: Query, given: PartSet, camera: Camera) -> float:
    """Overlap of the picture's object with the parts as the camera sees them, in [0, 1]."""
    assert question.image is not None
    shown = foreground(question.image)
    drawn = PartScene(given.meshes).rasterize(camera).part_ids != NOTHING
    either = float(np.logical_or(shown, drawn).sum())
    return float(np.logical_and(shown, drawn).sum()) / max(either, 1.0)


def _layers(folder: Path) -> tuple[str, ...]:
    content = json.loads((folder / "built.json").read_text(encoding="utf-8"))
    return tuple(content["layers"])


def _told(made: MakeResult, story: MakeRecord, folder: Path) -> MakeResult:
    """Write the page and what else tells of it, and return what was made."""
    recorded = write_recording(folder / RECORDING_FILE, story)
    made = replace(made, recording=recorded)
    write_json(folder / MADE_FILE, made.content())
    write_trace(made, story, folder / TRACE_FILE)
    return made
