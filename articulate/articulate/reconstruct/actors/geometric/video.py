"""The joint of a clip: known parts before a known camera, one of which is moved."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.errors import UsageError
from articulate.reconstruct.actors.geometric.camera_calibration import calibrated
from articulate.reconstruct.actors.geometric.comoving_parts import with_company
from articulate.reconstruct.actors.geometric.critic import VideoCritic
from articulate.reconstruct.actors.geometric.fit import Wish, find_motion
from articulate.reconstruct.actors.geometric.image_pyramid import Scene, scene_of
from articulate.reconstruct.actors.geometric.images import compared
from articulate.reconstruct.actors.geometric.parent_part import holder_of
from articulate.reconstruct.actors.geometric.refine_motion import roundest
from articulate.reconstruct.actors.geometric.residual_motion import rest_of
from articulate.reconstruct.actors.geometric.search import Fit
from articulate.reconstruct.actors.geometric.spin import WHOLE_RAD
from articulate.reconstruct.actors.loop import MAX_ITERATIONS, Loop
from articulate.reconstruct.actors.protocol import (
    ActorAttempt,
    Evidence,
    PredictedJoint,
    Prediction,
    TraceStep,
)

UNSEEN = 0.1
"""Confidence where nothing shows in the clip."""


def video_actor(
    *, max_iterations: int = MAX_ITERATIONS, critic: bool = True, calibrate: bool = True, tracks: bool = True
) -> Loop:
    """The geometric actor for clips, with its critic.

    Args:
        max_turns: Most proposals.
        critic: Whether proposals are judged; without, the first is the answer.
        calibrate: Whether the camera is sought near the one that was told; without, that one is
            taken for the true one, and for one that stands still.
        tracks: Whether the critic asks points that are followed, beside edges.
    """
    return Loop(
        proposer=VideoProposer(),
        critic=VideoCritic(tracks=tracks) if critic else None,
        max_iterations=max_iterations,
        prepare=calibrated if calibrate else None,
        rest=rest_of,
    )


@dataclass(frozen=True)
class VideoProposer:
    """Finds which part moves in a clip, and how."""

    name: str = "geometric"

    def propose(self, evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Prediction:
        """The joint that explains the clip best, other than what a critic found wrong before.

        Raises:
            UsageError: There is no clip, no camera, or the parts are not in their places.
        """
        start = time.monotonic()
        scene = scene_from(evidence)
        if not scene.change.any():
            fit, note = (None if attempts else roundest(scene)), "nothing changes in the clip"
        else:
            fit, note = find_motion(scene, _wish(evidence, attempts)), ""
            fit = None if fit is None else with_company(scene, fit)
        if fit is None:
            reason = note or "no part of the object explains what changes in the clip"
            return Prediction(joints=(), rejection=reason)
        joints = joints_of(fit, scene, UNSEEN if note else 1.0)
        return Prediction(joints=joints, trace=(_step(fit, scene, note, start),))


def scene_from(evidence: Evidence) -> Scene:
    """The clip of ``evidence`` and the object in it.

    Raises:
        UsageError: There is no clip, no camera, or the parts are not in their places.
    """
    if evidence.video is None or len(evidence.video) < 2:
        raise UsageError("the video actor was given no clip of two frames or more; give one")
    if evidence.camera is None:
        raise UsageError("the video actor needs the camera of the clip; give it with the clip")
    if not evidence.placed:
        raise UsageError("the video actor needs parts in their places; place them first")
    if not evidence.parts:
        raise UsageError("the video actor was given no parts; give one mesh for each")
    return scene_of(evidence.video, evidence.camera, evidence.parts)


def joints_of(fit: Fit, scene: Scene, confidence: float) -> tuple[PredictedJoint, ...]:
    """``fit`` as joints: the one that moves, and what is fixed to it."""
    names = [part.name for part in scene.parts]
    lead, *others = fit.parts
    still = [part for k, part in enumerate(scene.parts) if k not in fit.parts]
    axis = tuple(float(x) for x in fit.motion.axis_o)
    pivot = tuple(float(x) for x in fit.motion.pivot_o)
    low, high = float(fit.q.min()), float(fit.q.max())
    kind = "prismatic" if fit.motion.kind == "slide" else "revolute"
    if kind == "revolute":
        if high - low >= WHOLE_RAD:
            kind = "continuous"
        else:
            whole = 2.0 * np.pi * round((low + high) / (4.0 * np.pi))
            low, high = low - whole, high - whole
    moved = PredictedJoint(
        part=names[lead],
        parent=holder_of(scene.parts[lead], still, fit.motion, fit.q),
        kind=kind,  # type: ignore[arg-type]  # one of three literals
        axis_o=axis,  # type: ignore[arg-type]  # of length 3
        pivot_o=pivot,  # type: ignore[arg-type]  # of length 3
        lower=None if kind == "continuous" else low,
        upper=None if kind == "continuous" else high,
        confidence=confidence,
    )
    fixed = [PredictedJoint(part=names[k], parent=names[lead], kind="fixed") for k in others]
    return (moved, *fixed)


def _wish(evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Wish:
    """What to look for, given what was found wrong."""
    wish = Wish()
    names = [part.name for part in evidence.parts]
    for attempt in attempts:
        if attempt.verdict is None or not attempt.joints:
            continue
        joint = attempt.joints[0]
        if attempt.verdict.failure == "joint_type" and wish.kind is None:
            wish = replace(wish, kind="turn" if joint.kind == "prismatic" else "slide")
        elif attempt.verdict.failure in {"joint_axis", "joint_origin"}:
            wish = replace(wish, not_axes=(*wish.not_axes, joint.axis_o))
        else:
            wish = Wish(not_parts=(*wish.not_parts, names.index(joint.part)))
    return wish


def _step(fit: Fit, scene: Scene, note: str, start: float) -> TraceStep:
    names = [scene.parts[k].name for k in fit.parts]
    text = f"{', '.join(names)}: {fit.motion.kind} ({fit.motion.source})"
    figures: dict[str, float] = {
        "least_position": float(fit.q.min()),
        "most_position": float(fit.q.max()),
        "gain": fit.gain,
    }
    pictures = {} if note else {"clip above, model below": compared(scene, fit)}
    return TraceStep(
        title="what moves, and how",
        text=f"{note}; {text}" if note else text,
        figures=figures,
        images=pictures,
        seconds=time.monotonic() - start,
    )
