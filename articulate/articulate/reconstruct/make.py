"""Reconstruct an object: from a query and parts to a folder with a checked URDF and a trace.

::

    Query + PartSet ─► Evidence ─► Actor ⇄ Critic ─► program ─► URDF ─► CheckReport ─► folder
"""

from __future__ import annotations

import itertools
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
from articulate.errors import ConfigError, UsageError, nearest, quote, shorten
from articulate.files import copy_writable, write_json
from articulate.preparation.batch import Batch, Item
from articulate.preparation.store import check_out, export
from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.protocol import (
    GOOD_ENOUGH,
    Actor,
    Evidence,
    PredictedJoint,
    Prediction,
)
from articulate.reconstruct.actors.registry import make_actor
from articulate.reconstruct.actors.vlm.dry_run import DryRunSize, write_dry_run
from articulate.reconstruct.hinge_adjustment import (
    PartJoints,
    adjust_hinge,
    describe_adjustment,
    diagonal_of,
)
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
    Verdict,
)
from articulate.reconstruct.text.counts import count_mismatch
from articulate.reconstruct.trace import write_trace
from articulate.render.camera import Camera
from articulate.render.scene import NO_PART, PartScene

ACTORS = {"video": "geometric-video", "image": "geometric-text", "text": "geometric-text"}
"""Default actor of each modality."""
TEXT_ACTOR = "geometric-text"
"""Actor for joints that a video does not show."""
MIN_CONFIDENCE = 0.35
"""A joint with a lower confidence makes the result doubtful."""
MIN_OVERLAP = 0.5
"""A smaller overlap of the object in the image with the rendered parts is doubtful."""


def make(query: Query, part_set: PartSet, camera: Camera, request: MakeRequest) -> MakeResult:
    """Find joints, write the program, check what it describes, and write the folder.

    Nothing is written unless there is an object.

    Raises:
        UsageError: No joint is found, or the folder cannot be written.
    """
    check_out(request.out)
    start = time.monotonic()
    _check_joint(request.joint, part_set)
    prediction, actor_name = _predict(query, part_set, camera, request)
    prediction = replace(prediction, trace=(*part_set.trace, *prediction.trace))
    if not part_set.placed:
        part_set = part_set.with_placements(prediction.placements)
    source = PredictionSource(query=query, camera=camera, actor=actor_name, start=start)
    return make_predicted(prediction, part_set, request, source)


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionSource:
    """Origin of predicted joints."""

    query: Query
    camera: Camera
    actor: str
    """Name of the actor."""
    start: float
    """Start of the reconstruction, by ``time.monotonic`` [s]."""
    doubts: tuple[str, ...] = ()
    """Reasons why the object may not be the intended one."""
    assumptions: tuple[str, ...] = ()
    """Values that the query does not give, and where they come from."""


def make_predicted(
    prediction: Prediction, part_set: PartSet, request: MakeRequest, source: PredictionSource
) -> MakeResult:
    """Write the program of predicted joints, check what it describes, and write the folder.

    Raises:
        UsageError: No joint moves, or the folder cannot be written.
    """
    query, actor_name = source.query, source.actor
    predicted = time.monotonic()
    part_joints: PartJoints
    root, part_joints = tree_of(_selected(prediction.joints, request.joint), part_set.meshes)
    if all(joint.kind == "fixed" for joint in part_joints.values()):
        raise UsageError(_nothing_moves(query, request.joint))
    program = prediction.program if _is_complete(prediction, part_joints) else ""
    checker = _ProgramChecker(part_set=part_set, request=request, actor=actor_name)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        if program:
            check_report = checker.check(program, work)
        else:
            write = partial(program_of, root, actor=actor_name, query=query.description)
            adjusted, check_report = checker.check_or_adjust(part_joints, write, work)
            if adjusted is not part_joints:
                step = describe_adjustment(part_joints, adjusted)
                prediction = replace(prediction, trace=(*prediction.trace, step))
                part_joints = adjusted
        record = MakeRecord(
            part_set=part_set,
            query=query,
            camera=source.camera,
            actor=actor_name,
            prediction=prediction,
            root=root,
            part_joints=part_joints,
            program=program or write(part_joints),
            layers=_layers(work / PROGRAM_FOLDER),
            seconds={"joints": predicted - source.start, **checker.seconds},
        )
        result = _result(record, check_report, request, source)
        copy_writable(work / PROGRAM_FOLDER, work / "asset" / PROGRAM_FOLDER)
        result = _write_reports(result, record, work / "asset")
        export(work / "asset", request.out)
    return result


def dry_run(
    query: Query, part_set: PartSet, camera: Camera, request: MakeRequest, path: Path
) -> DryRunSize:
    """Write the requests to a model to the page ``path`` and return their size.

    Raises:
        ConfigError: The actor uses no model.
    """
    evidence = _evidence(query, part_set, camera, request)
    description = f"{part_set.name}, {len(part_set.meshes)} parts, and {query.description}"
    return write_dry_run(_actor(request, query), evidence, path, description)


@dataclass(frozen=True, kw_only=True)
class _ProgramChecker:
    """Compiles a program and checks the object that it describes."""

    part_set: PartSet
    request: MakeRequest
    actor: str
    seconds: dict[str, float] = field(default_factory=lambda: {"program": 0.0, "checks": 0.0})

    def check(self, source: str, work: Path) -> CheckReport:
        """Compile a program and check the object in a child process; the asset goes to ``work``.

        Raises:
            UsageError: The program cannot be compiled.
        """
        start = time.monotonic()
        urdf = compile_program(source, self.part_set.parts, work / PROGRAM_FOLDER)
        if isinstance(urdf, ProgramError):
            raise UsageError(f"the program of {self.actor} cannot be compiled: {urdf}")
        self.part_set.write_origin(work / PROGRAM_FOLDER)
        compiled = time.monotonic()
        request = self.request
        batch = Batch(
            out=work / "asset",
            cache=request.cache,
            options={},
            limit_s=request.limit_s,
            single=True,
        )
        check_report = batch.one(Item(name=urdf.stem, file=urdf)).check_report
        self.seconds["program"] += compiled - start
        self.seconds["checks"] += time.monotonic() - compiled
        return check_report

    def check_or_adjust(
        self, part_joints: PartJoints, write: Callable[[PartJoints], str], work: Path
    ) -> tuple[PartJoints, CheckReport]:
        """Check an object; adjust a hinge within its estimation error if it is rejected."""
        name, report, trials = self.part_set.name, self.request.progress, itertools.count(1)
        report(f"{name}: checking {len(part_joints)} joints")
        check_report = self.check(write(part_joints), work)
        if check_report.is_usable:
            return part_joints, check_report

        def check_moved(trial: PartJoints) -> CheckReport:
            report(f"{name}: parts collide slightly; checking a moved hinge, trial {next(trials)}")
            return self.check(write(trial), work / "trial")

        size_m = diagonal_of(self.part_set.meshes)
        adjusted = adjust_hinge(part_joints, check_report, check_moved, size_m)
        if adjusted is None:
            return part_joints, check_report
        return adjusted, self.check(write(adjusted), work)


def _is_complete(prediction: Prediction, part_joints: Mapping[str, PredictedJoint]) -> bool:
    """Return whether the actor's own program has exactly the requested joints."""
    predicted = {joint.part: joint.kind for joint in prediction.joints}
    return predicted == {part: joint.kind for part, joint in part_joints.items()}


def _actor(request: MakeRequest, query: Query) -> Actor:
    """Create the actor with the requested number of proposals."""
    actor = request.models.apply(make_actor(_actor_name(request, query)))
    if request.iterations is not None and isinstance(actor, Loop):
        return replace(actor, max_iterations=request.iterations)
    return actor


def _actor_name(request: MakeRequest, query: Query) -> str:
    return ACTORS[query.modality] if request.actor == "auto" else request.actor


def _evidence(query: Query, part_set: PartSet, camera: Camera, request: MakeRequest) -> Evidence:
    return Evidence(
        modality=query.modality,
        parts=part_set.meshes,
        labels=part_set.labels,
        placed=part_set.placed,
        video=query.video,
        times_s=query.times_s,
        image=query.image,
        camera=None if query.modality == "text" or not part_set.aligned else camera,
        text=f"{query.text} {part_set.kind}".strip(),
        seed=request.seed,
    )


def _predict(
    query: Query, part_set: PartSet, camera: Camera, request: MakeRequest
) -> tuple[Prediction, str]:
    """Return the prediction and the name of the actor."""
    evidence = _evidence(query, part_set, camera, request)
    prediction = _actor(request, query).predict(evidence)
    name = _actor_name(request, query)
    if prediction.rejection:
        raise UsageError(f"{query.description}: {prediction.rejection}")
    if query.modality == "video" and request.joint == "all":
        others = make_actor(TEXT_ACTOR).predict(replace(evidence, video=None, modality="text"))
        prediction = replace(prediction, joints=_with_unseen(prediction.joints, others.joints))
        name = f"{name} and {TEXT_ACTOR}"
    return prediction, name


def _with_unseen(
    seen: Sequence[PredictedJoint], named: Sequence[PredictedJoint]
) -> tuple[PredictedJoint, ...]:
    """Combine joints of the video with joints from names, for parts that do not move in it.

    A knob that moves along with its door in the video may still turn on the door.
    """
    moved = {joint.part for joint in seen if joint.kind != "fixed"}
    carried = {joint.part for joint in seen if joint.kind == "fixed"}
    more = [j for j in named if j.part not in (moved if j.kind != "fixed" else moved | carried)]
    return (*seen, *more)


def _check_joint(selected: str, part_set: PartSet) -> None:
    names = [mesh.name for mesh in part_set.meshes]
    if selected not in {"auto", "all", *names}:
        raise ConfigError(
            f"--joint {quote(selected)}: must be auto, all or a part{nearest(selected, names)}"
        )


def _selected(joints: Sequence[PredictedJoint], selected: str) -> list[PredictedJoint]:
    """Return the requested joints, and all fixed ones."""
    if selected in {"auto", "all"}:
        return list(joints)
    return [j for j in joints if j.part == selected or j.kind == "fixed"]


def _nothing_moves(query: Query, selected: str) -> str:
    if selected not in {"auto", "all"}:
        return (
            f"{query.description}: no joint of {selected} was found; give another --joint or "
            "omit it"
        )
    return (
        f"{query.description}: no joint was found; name the parts by their function (door, "
        "drawer, lid, handle …), or give a video"
    )


def _result(
    record: MakeRecord, check_report: CheckReport, request: MakeRequest, source: PredictionSource
) -> MakeResult:
    """Combine the check report and the doubts about the prediction."""
    doubts = [*source.doubts, *_doubts(record)]
    verdict: Verdict
    if check_report.is_usable:
        verdict, reasons = ("doubtful" if doubts else "passed"), doubts
    else:
        # The folder of the check is temporary; its path means nothing later.
        lasting = [re.sub(r"\S*/(?=object\.urdf: )", "", text) for text in check_report.reasons]
        verdict = "undecided" if check_report.verdict == "undecided" else "rejected"
        reasons = [*lasting, *doubts]
    return MakeResult(
        verdict=verdict,
        reasons=tuple(reasons),
        out=request.out,
        joints=tuple(record.moving),
        check_report=check_report,
        rating=record.prediction.rating,
        seconds=time.monotonic() - source.start,
        assumptions=source.assumptions,
    )


def _doubts(record: MakeRecord) -> list[str]:
    """List the reasons why the object may not be the intended one."""
    verdict, query = record.prediction.verdict, record.query
    doubts = []
    if verdict is not None and not verdict.rating > GOOD_ENOUGH:
        what = verdict.failure.replace("_", " ")
        reason = verdict.reason or "no reason"
        doubts.append(f"the critic rates it {verdict.rating:.1f} of 10 ({what}: {reason})")
    unsure = [j for j in record.moving if j.confidence < MIN_CONFIDENCE]
    if unsure:
        names = ", ".join(f"{j.part} ({j.confidence:.2f})" for j in unsure)
        doubts.append(f"the actor has little confidence in {names}")
    if not record.part_set.aligned:
        doubts.append(f"the parts are those of a similar object: {shorten(record.part_set.source)}")
    if query.text:
        doubts += count_mismatch(query.text, record.part_set.labels.values())
    if query.image is not None and record.part_set.aligned:
        share = overlap(query, record.part_set, record.camera)
        if share < MIN_OVERLAP:
            doubts.append(
                f"image and parts overlap by {share:.0%}: another object, or another camera"
            )
    return doubts


def overlap(query: Query, part_set: PartSet, camera: Camera) -> float:
    """Compute the overlap of the object in the image with the rendered parts, in [0, 1]."""
    assert query.image is not None
    pictured = foreground(query.image)
    rendered = PartScene(part_set.meshes).rasterize(camera).part_ids != NO_PART
    either = float(np.logical_or(pictured, rendered).sum())
    return float(np.logical_and(pictured, rendered).sum()) / max(either, 1.0)


def _layers(folder: Path) -> tuple[str, ...]:
    content = json.loads((folder / "built.json").read_text(encoding="utf-8"))
    return tuple(content["layers"])


def _write_reports(result: MakeResult, record: MakeRecord, folder: Path) -> MakeResult:
    """Write the result, the page and the recording, and return the result."""
    result = replace(result, recording=write_recording(folder / RECORDING_FILE, record))
    write_json(folder / MADE_FILE, result.content())
    write_trace(result, record, folder / TRACE_FILE)
    return result
