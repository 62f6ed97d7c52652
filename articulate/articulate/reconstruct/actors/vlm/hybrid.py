"""Joints of which a model chooses part, kind and candidate, and geometry computes all numbers.

The model names the moving parts and the kinds of their joints. It then chooses among the joint
candidates that geometry offers for these parts, and the direction in which they open. With a video,
geometry fits axis, pivot and limits near the chosen candidate; without one the candidate itself is
the joint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from articulate.errors import quote
from articulate.reconstruct.actors.geometric.fit import MotionConstraints, find_motion
from articulate.reconstruct.actors.geometric.surface import JointMotion
from articulate.reconstruct.actors.geometric.video import joints_of, scene_from_evidence
from articulate.reconstruct.actors.protocol import (
    ActorAttempt,
    Evidence,
    PredictedJoint,
    Prediction,
)
from articulate.reconstruct.actors.semantic.part_relations import (
    LabelledScene,
    build_labelled_scene,
)
from articulate.reconstruct.actors.vlm.answers import Choices, MovingPart, MovingParts
from articulate.reconstruct.actors.vlm.joint_candidates import (
    JointCandidate,
    candidates_image,
    describe_candidates,
    joint_candidates,
    typical_joint,
    with_carriers,
)
from articulate.reconstruct.actors.vlm.model import Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import describe_attempts, evidence_content
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import schema_of

WHICH = {
    "video": "Name the part that moves in the video; several only if they move independently.",
    "image": "Name all parts that can move, whether they are open or closed.",
    "text": "Name all parts that can move.",
}
NEAR_SHARE = 0.15
"""Largest distance of a fitted axis from the chosen one, as a share of the part's size."""
MAX_IMAGES = 4
"""Most parts whose candidates are rendered."""


def choose_joints(
    session: ModelSession, evidence: Evidence, attempts: Sequence[ActorAttempt]
) -> Prediction:
    """Return the joints that a model chooses.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    request = movers_request(evidence, attempts)
    movers = session.generate(request, MovingParts, _check_parts(evidence)).movers
    if not movers:
        return Prediction(joints=(), rejection=f"{session.model.name} names no moving part")
    scene = with_carriers(build_labelled_scene(evidence), movers)
    candidates = joint_candidates(movers, scene)
    request = choices_request(evidence, candidates, attempts)
    choices = session.generate(request, Choices, _check_choices(movers, candidates)).choices
    chosen = [(candidates[choice.candidate - 1], choice.opens) for choice in choices]
    if evidence.video is not None and evidence.camera is not None:
        return _fit_joints([candidate for candidate, _ in chosen], evidence, scene)
    joints = [typical_joint(candidate, opens, scene) for candidate, opens in chosen]
    return Prediction(joints=(*joints, *_carried(joints, scene)))


def movers_request(evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Request:
    """Create the request for the moving parts."""
    return Request(
        title="moving parts",
        system=prompt("frame").filled(),
        turns=(
            Turn(
                "user",
                (
                    prompt("movers").filled(which=WHICH[evidence.modality]),
                    *evidence_content(evidence),
                    *describe_attempts(attempts),
                ),
            ),
        ),
        schema=schema_of(MovingParts),
    )


def choices_request(
    evidence: Evidence, candidates: Sequence[JointCandidate], attempts: Sequence[ActorAttempt]
) -> Request:
    """Create the request to choose among the candidates."""
    groups = [list(group) for _, group in groupby(candidates, key=lambda candidate: candidate.part)]
    images = [candidates_image(evidence, group) for group in groups[:MAX_IMAGES]]
    return Request(
        title="choice among joint candidates",
        system=prompt("frame").filled(),
        turns=(
            Turn(
                "user",
                (
                    prompt("choices").filled(candidates=describe_candidates(candidates)),
                    *evidence_content(evidence),
                    *images,
                    *describe_attempts(attempts),
                ),
            ),
        ),
        schema=schema_of(Choices),
    )


def _check_parts(evidence: Evidence) -> Callable[[MovingParts], str]:
    names = [part.name for part in evidence.parts]

    def check(answer: MovingParts) -> str:
        named = [mover.part for mover in answer.movers]
        for name in named:
            if name not in names:
                return f"there is no part {quote(name)}; the parts are {', '.join(names)}"
            if named.count(name) > 1:
                return f"{name} is named twice; name each part once"
        return "at least one part is fixed" if len(named) == len(names) else ""

    return check


def _check_choices(
    movers: Sequence[MovingPart], candidates: Sequence[JointCandidate]
) -> Callable[[Choices], str]:
    wanted = sorted(mover.part for mover in movers)

    def check(answer: Choices) -> str:
        if sorted(choice.part for choice in answer.choices) != wanted:
            return f"choose one candidate for each of {', '.join(wanted)}"
        for choice in answer.choices:
            known = [c.number for c in candidates if c.part == choice.part]
            if choice.candidate not in known:
                return (
                    f"candidate {choice.candidate} is not one of {choice.part}; "
                    f"known: {known[0]} to {known[-1]}"
                )
        return ""

    return check


def _fit_joints(
    chosen: Sequence[JointCandidate], evidence: Evidence, scene: LabelledScene
) -> Prediction:
    """Fit joints near the chosen candidates to the video."""
    video = scene_from_evidence(evidence)
    names = [part.name for part in video.parts]
    joints: list[PredictedJoint] = []
    for candidate in chosen:
        near = JointMotion(
            "slide" if candidate.kind == "prismatic" else "turn",
            candidate.axis_o,
            candidate.pivot_o,
            f"candidate {candidate.number}",
        )
        size = float(np.linalg.norm(scene.shapes[candidate.part].size))
        constraints = MotionConstraints(
            kind=near.kind, part=names.index(candidate.part), near=near, near_m=NEAR_SHARE * size
        )
        fit = find_motion(video, constraints) if video.change.any() else None
        if fit is None:
            name = f"{candidate.kind} joint of {candidate.part}"
            return Prediction(joints=(), rejection=f"no {name} explains the changes in the video")
        lead, *fixed = joints_of(fit, video, 1.0)
        known_parts = {joint.part for joint in joints}
        joints += [
            _of_kind(lead, candidate, fit.q),
            *(j for j in fixed if j.part not in known_parts),
        ]
    return Prediction(joints=tuple({joint.part: joint for joint in joints}.values()))


def _of_kind(joint: PredictedJoint, candidate: JointCandidate, q: np.ndarray) -> PredictedJoint:
    """Return the joint with the kind of the candidate."""
    if candidate.kind == "continuous":
        return replace(joint, kind="continuous", lower=None, upper=None)
    if joint.kind == "continuous":
        return replace(joint, kind="revolute", lower=float(q.min()), upper=float(q.max()))
    return joint


def _carried(joints: Sequence[PredictedJoint], scene: LabelledScene) -> list[PredictedJoint]:
    """Return fixed joints of the parts that moving parts carry."""
    moving = {joint.part for joint in joints}
    return [
        PredictedJoint(part=name, parent=on, kind="fixed")
        for name, on in scene.parent_names.items()
        if name not in moving and on in moving
    ]
