"""Sampled motions of rendered videos: the joint, its positions, and the operator's palm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.benchmark.truth import TrueObject
from articulate.errors import AssetError
from articulate.render.camera import Camera
from articulate.transforms import Array, apply, axis_angle_to_matrix, normalised, pose


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Shares of the videos with a property."""

    arm: float = 0.6
    """An arm operates the part."""
    person: float = 0.2
    """A person walks in the image."""
    tripod: float = 0.3
    """The camera does not move."""
    other_joint: float = 0.25
    """The object's joint is replaced: a box slides along any axis or turns about any edge."""
    blur: float = 0.3
    """Frames are averages over the exposure time."""
    jpeg: float = 0.5
    """Frames are compressed one by one, before the video is."""
    entire: bool = False
    """The camera of ``rendered_photo`` shows the entire object."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatedJoint:
    """The joint to move, in the object's frame."""

    kind: Literal["revolute", "prismatic"]
    axis: Array
    pivot: Array
    lower: float
    upper: float
    moves: tuple[str, ...]
    own: bool

    def motion(self, position: float) -> Array:
        """Return the transform (4, 4) of the moving parts."""
        if self.kind == "prismatic":
            return pose(position * self.axis)
        turn = axis_angle_to_matrix(self.axis, position)
        return pose(self.pivot - turn @ self.pivot, turn)


def sample_joint(
    rng: np.random.Generator, true: TrueObject, kind: str | None, how: Conditions
) -> OperatedJoint:
    """Sample a joint of an object, or one that the object does not have.

    Raises:
        AssetError: The object has no joint of the type ``kind``.
    """
    if rng.random() < how.other_joint:
        return _other_joint(rng, true, kind)
    found = []
    for known in true.joints:
        slides = known.joint.kind == "prismatic"
        if kind is not None and slides != (kind == "prismatic"):
            continue
        found.append(known)
    if not found:
        raise AssetError(f"{true.object_id}: has no {kind or 'scored'} joint")
    sizes = np.array([np.ptp(true.box_of(k.moves), axis=0).max() for k in found])
    known = found[int(rng.choice(len(found), p=sizes / sizes.sum()))]
    spec = known.joint
    lower, upper = (
        (float(spec.lower), float(spec.upper))
        if spec.lower is not None and spec.upper is not None
        else (0.0, float(rng.uniform(0.8, 2.5)))
    )
    if abs(lower) > abs(upper):
        lower, upper = upper, lower
    return OperatedJoint(
        kind="prismatic" if spec.kind == "prismatic" else "revolute",
        axis=normalised(spec.axis_o),
        pivot=np.asarray(spec.pivot_o, dtype=np.float64),
        lower=lower,
        upper=upper,
        moves=known.moves,
        own=True,
    )


def _other_joint(rng: np.random.Generator, true: TrueObject, kind: str | None) -> OperatedJoint:
    """Return a joint that the object does not have, so that its look does not give the type."""
    movable = [known.moves for known in true.joints]
    if not movable:
        raise AssetError(f"{true.object_id}: has no scored joint")
    moves = movable[int(rng.integers(len(movable)))]
    low, high = true.box_of(moves)
    size, centre = high - low, 0.5 * (low + high)
    slides = kind == "prismatic" if kind is not None else rng.random() < 0.5
    if slides:
        axis = np.eye(3)[int(rng.integers(3))] * rng.choice([-1.0, 1.0])
        reach = float(rng.uniform(0.3, 1.1)) * float(np.sort(size)[1:].mean())
        return OperatedJoint(
            kind="prismatic",
            axis=axis,
            pivot=centre,
            lower=0.0,
            upper=reach,
            moves=moves,
            own=False,
        )
    along = int(rng.choice(3, p=[0.2, 0.4, 0.4]))
    pivot = centre.copy()
    for k in range(3):
        if k != along:
            pivot[k] = rng.choice([low[k], high[k]])
    turn = rng.choice([-1.0, 1.0]) * float(rng.uniform(0.6, 2.0))
    return OperatedJoint(
        kind="revolute",
        axis=np.eye(3)[along],
        pivot=pivot,
        lower=0.0,
        upper=turn,
        moves=moves,
        own=False,
    )


def sample_positions(rng: np.random.Generator, joint: OperatedJoint, n_frames: int) -> Array:
    """Return joint positions (T,): strokes at uneven speed, with pauses before, between, after."""
    span = joint.upper - joint.lower
    if joint.kind == "revolute":
        span = math.copysign(min(abs(span), 2.6), span)
    near = 0.0 if rng.random() < 0.75 else float(rng.uniform(0.0, 0.35))
    far = float(rng.uniform(max(0.4, near + 0.35), 1.0))
    plan = rng.choice(["open", "close", "both", "reverse"], p=[0.5, 0.27, 0.18, 0.05])
    stops = {
        "open": [near, far],
        "close": [far, near],
        "both": [near, far, near + 0.4 * float(rng.random()) * (far - near)],
        "reverse": [far, near, near + float(rng.uniform(0.6, 1.0)) * (far - near)],
    }[str(plan)]
    if rng.random() < 0.3:  # a pause in the first stroke
        middle = stops[0] + float(rng.uniform(0.3, 0.7)) * (stops[1] - stops[0])
        stops = [stops[0], middle, *stops[1:]]
    rests = rng.uniform(0.0, 0.12, size=len(stops) - 2)
    before = float(rng.choice([0.0, rng.uniform(0.05, 0.3)], p=[0.35, 0.65]))
    after = float(rng.choice([0.0, rng.uniform(0.05, 0.3)], p=[0.35, 0.65]))
    strokes = rng.uniform(0.6, 1.4, size=len(stops) - 1)
    strokes *= (1.0 - before - after - rests.sum()) / strokes.sum()
    times, values, t = [0.0, before], [stops[0], stops[0]], before
    for k, stroke in enumerate(strokes):
        u = np.linspace(0.0, 1.0, 12)[1:]
        ease = u + float(rng.uniform(-0.1, 0.16)) * np.sin(2 * np.pi * u) / 1.1
        ease = ease + 0.02 * float(rng.standard_normal()) * np.sin(4 * np.pi * u)
        values += list(stops[k] + ease * (stops[k + 1] - stops[k]))
        times += list(t + stroke * u)
        t += float(stroke)
        if k < len(rests):
            t += float(rests[k])
            times.append(t)
            values.append(stops[k + 1])
    times.append(1.001)
    values.append(stops[-1])
    shares = np.interp(np.linspace(0.0, 1.0, n_frames), times, values)
    return np.asarray(joint.lower + span * shares)


def palm_path(
    rng: np.random.Generator,
    true: TrueObject,
    joint: OperatedJoint,
    positions: Array,
    camera: Camera,
    shoulder: Array,
) -> tuple[Array, float]:
    """Return the positions of the palm (T, 3) and its radius [m]."""
    points = np.concatenate([p.vertices for p in true.parts if p.name in joint.moves])
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    if joint.kind == "revolute":
        arm = np.linalg.norm(np.cross(points - joint.pivot, joint.axis), axis=1)
    else:
        arm = (points - points.mean(axis=0)) @ joint.axis
        off = points - points.mean(axis=0)
        arm = arm - 0.3 * np.linalg.norm(off - np.outer(off @ joint.axis, joint.axis), axis=1)
    arm = arm - 0.15 * np.linalg.norm(points - camera.eye_w, axis=1)
    arm = arm + 0.1 * size * rng.standard_normal(len(points))
    grasp = points[int(np.argmax(arm))]
    radius = float(np.clip(size * rng.uniform(0.05, 0.2), 0.04, 0.22))
    n = len(positions)
    held = np.stack([apply(joint.motion(float(q)), grasp) for q in positions])
    towards = normalised(shoulder - held)
    held = held + 0.7 * radius * towards
    slip = float(rng.choice([0.0, 0.3], p=[0.7, 0.3])) * size
    held = held + slip * np.linspace(0, 1, n)[:, None] * normalised(rng.standard_normal(3)) * 0.5
    changes = np.nonzero(np.abs(np.diff(positions)) > 1e-6)[0]
    begin, end = int(changes[0]), int(changes[-1]) + 1
    there = np.ones(n)
    lead = int(rng.integers(4, 14))
    if begin > 2:
        there[:begin] = np.clip(1.0 - (begin - np.arange(begin)) / lead, 0.0, 1.0)
    if end < n - 3 and rng.random() < 0.8:
        stay = min(n - 1, end + int(rng.integers(0, 5)))
        there[stay:] = np.clip(1.0 - np.arange(n - stay) / lead, 0.0, 1.0)
    smooth = there * there * (3.0 - 2.0 * there)
    away = shoulder + 0.25 * (held[0] - shoulder)
    return np.asarray(away + smooth[:, None] * (held - away)), radius


def sample_shoulder(rng: np.random.Generator, camera: Camera, at: Array) -> Array:
    """Return a point beyond a border of the image (3,), between the camera and ``at``."""
    border = rng.choice(["left", "right", "bottom", "top"], p=[0.35, 0.35, 0.25, 0.05])
    width, height = camera.width_px, camera.height_px
    beyond = float(rng.uniform(0.1, 0.5))
    across = float(rng.uniform(0.2, 1.0))
    uv = {
        "left": (-beyond * width, across * height),
        "right": ((1 + beyond) * width, across * height),
        "bottom": (across * width, (1 + beyond) * height),
        "top": (across * width, -beyond * height),
    }[str(border)]
    depth = float(apply(camera.T_cw, at)[2]) * float(rng.uniform(0.5, 0.95))
    return np.asarray(camera.unproject(np.array(uv), np.array(depth)))
