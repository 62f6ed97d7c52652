"""Geometric actor for videos: known parts, a known camera, one part that moves."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.errors import UsageError
from articulate.reconstruct.actors.geometric.camera import calibrate_evidence
from articulate.reconstruct.actors.geometric.critic import VideoCritic
from articulate.reconstruct.actors.geometric.fit import MotionConstraints, find_motion
from articulate.reconstruct.actors.geometric.image_pyramid import (
    VideoScene,
    build_scene,
    comparison_image,
)
from articulate.reconstruct.actors.geometric.parameters import CRITIC, SYMMETRY
from articulate.reconstruct.actors.geometric.parts import (
    add_comoving_parts,
    find_parent,
    residual_evidence,
)
from articulate.reconstruct.actors.geometric.refine import guess_round_part
from articulate.reconstruct.actors.geometric.search import MotionFit
from articulate.reconstruct.actors.loop import MAX_ITERATIONS, Loop
from articulate.reconstruct.actors.protocol import (
    ActorAttempt,
    Evidence,
    PredictedJoint,
    Prediction,
    TraceStep,
)


def video_actor(
    *,
    max_iterations: int = MAX_ITERATIONS,
    critic: bool = True,
    calibrate: bool = True,
    tracks: bool = True,
) -> Loop:
    """Create the geometric actor for videos, with its critic.

    Args:
        max_iterations: Proposals at most.
        critic: Use the critic; otherwise the first proposal is the answer.
        calibrate: Refine the camera close to the given one and stabilize the video; otherwise the
            given camera is used as it is.
        tracks: Let the critic use point tracks in addition to edges.
    """
    return Loop(
        proposer=VideoProposer(),
        critic=VideoCritic(tracks=tracks) if critic else None,
        max_iterations=max_iterations,
        prepare=calibrate_evidence if calibrate else None,
        residual=residual_evidence,
    )


@dataclass(frozen=True)
class VideoProposer:
    """Proposer of the part that moves in a video and of its joint."""

    name: str = "geometric"

    def propose(self, evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Prediction:
        """Return the joint that explains the video best, other than those rejected before.

        Raises:
            UsageError: There is no video, no camera, or the parts are not in their places.
        """
        start = time.monotonic()
        scene = scene_from_evidence(evidence)
        if not scene.change.any():
            fit, note = (
                (None if attempts else guess_round_part(scene)),
                "nothing changes in the video",
            )
        else:
            fit, note = find_motion(scene, _constraints_from(evidence, attempts)), ""
            fit = None if fit is None else add_comoving_parts(scene, fit)
        if fit is None:
            reason = note or "no part of the object explains the changes in the video"
            return Prediction(joints=(), rejection=reason)
        joints = joints_of(fit, scene, CRITIC.unseen_confidence if note else 1.0)
        return Prediction(joints=joints, trace=(_step(fit, scene, note, start),))


def scene_from_evidence(evidence: Evidence) -> VideoScene:
    """Build the scene of ``evidence``.

    Raises:
        UsageError: There is no video, no camera, or the parts are not in their places.
    """
    if evidence.video is None or len(evidence.video) < 2:
        raise UsageError("the video actor needs a video of two frames or more")
    if evidence.camera is None:
        raise UsageError("the video actor needs the camera of the video")
    if not evidence.placed:
        raise UsageError("the video actor needs parts in their places; place them first")
    if not evidence.parts:
        raise UsageError("the video actor needs parts, one mesh for each")
    return build_scene(evidence.video, evidence.camera, evidence.parts)


def joints_of(fit: MotionFit, scene: VideoScene, confidence: float) -> tuple[PredictedJoint, ...]:
    """Convert ``fit`` to joints: the moving one, and fixed ones for the parts that move along."""
    names = [part.name for part in scene.parts]
    lead, *others = fit.parts
    still = [part for k, part in enumerate(scene.parts) if k not in fit.parts]
    axis = tuple(float(x) for x in fit.motion.axis_o)
    pivot = tuple(float(x) for x in fit.motion.pivot_o)
    low, high = float(fit.q.min()), float(fit.q.max())
    kind = "prismatic" if fit.motion.kind == "slide" else "revolute"
    if kind == "revolute":
        if high - low >= SYMMETRY.full_turn_rad:
            kind = "continuous"
        else:
            full_turns = 2.0 * np.pi * round((low + high) / (4.0 * np.pi))
            low, high = low - full_turns, high - full_turns
    moved = PredictedJoint(
        part=names[lead],
        parent=find_parent(scene.parts[lead], still, fit.motion, fit.q),
        kind=kind,  # type: ignore[arg-type]  # one of three literals
        axis_o=axis,  # type: ignore[arg-type]  # of length 3
        pivot_o=pivot,  # type: ignore[arg-type]  # of length 3
        lower=None if kind == "continuous" else low,
        upper=None if kind == "continuous" else high,
        confidence=confidence,
    )
    fixed = [PredictedJoint(part=names[k], parent=names[lead], kind="fixed") for k in others]
    return (moved, *fixed)


def _constraints_from(evidence: Evidence, attempts: Sequence[ActorAttempt]) -> MotionConstraints:
    """Derive constraints from rejected predictions."""
    constraints = MotionConstraints()
    names = [part.name for part in evidence.parts]
    for attempt in attempts:
        if attempt.verdict is None or not attempt.joints:
            continue
        joint = attempt.joints[0]
        if attempt.verdict.failure == "joint_type" and constraints.kind is None:
            constraints = replace(
                constraints, kind="turn" if joint.kind == "prismatic" else "slide"
            )
        elif attempt.verdict.failure in {"joint_axis", "joint_origin"}:
            constraints = replace(
                constraints, excluded_axes=(*constraints.excluded_axes, joint.axis_o)
            )
        else:
            constraints = MotionConstraints(
                excluded_parts=(*constraints.excluded_parts, names.index(joint.part))
            )
    return constraints


def _step(fit: MotionFit, scene: VideoScene, note: str, start: float) -> TraceStep:
    names = [scene.parts[k].name for k in fit.parts]
    text = f"{', '.join(names)}: {fit.motion.kind} ({fit.motion.source})"
    figures: dict[str, float] = {
        "least_position": float(fit.q.min()),
        "most_position": float(fit.q.max()),
        "gain": fit.gain,
    }
    images = {} if note else {"video above, model below": comparison_image(scene, fit)}
    return TraceStep(
        title="motion of the parts",
        text=f"{note}; {text}" if note else text,
        figures=figures,
        images=images,
        seconds=time.monotonic() - start,
    )


def without_critic() -> Loop:
    """Ablation: return the first proposal.

    ``articulate benchmark assets.json --actor
    articulate.reconstruct.actors.geometric.video:without_critic``
    """
    return video_actor(critic=False)


def without_tracks() -> Loop:
    """Ablation: the critic uses edges only."""
    return video_actor(tracks=False)


def without_calibration() -> Loop:
    """Ablation: the given camera is used as it is."""
    return video_actor(calibrate=False)
