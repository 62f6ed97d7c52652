"""Rendered videos of an operated joint with known truth, seen by an unknown camera.

The object, a textured room and an operator's arm are rendered together; the camera shakes and pans,
exposure drifts, fast motion is blurred, and the frames are compressed. Everything follows from the
object and a seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.benchmark.surroundings import (
    Arm,
    sample_arm,
    sample_person,
    sample_room,
    textured,
)
from articulate.benchmark.truth import TrueObject
from articulate.errors import AssetError
from articulate.render.camera import Camera, look_at, pinhole
from articulate.render.joint_video import Video
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.raster import Pixels
from articulate.render.scene import Light, PartScene
from articulate.transforms import Array, apply, axis_angle_to_matrix, normalised, pose

BACKGROUND, MOVING, STATIC, OPERATOR = 0, 1, 2, 3
"""Values of ``RenderedVideo.labels``."""
SENSOR_MM = 36.0
"""Width of the sensor that equivalent focal lengths refer to [mm]."""
SUPERSAMPLING = 1.4
"""Scale at which frames are rendered before they are reduced."""
TRIES = 14
"""Cameras that are sampled until the motion is well visible."""
MIN_PATH = 0.09
"""Least motion of a visible point of the part, as a share of the longest side."""
MIN_AREA = 0.02
"""Least visible area of the moving part, as a share of the image."""


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


@dataclass(frozen=True, kw_only=True)
class RenderedTruth:
    """The joint that moves, in the camera frame of the first frame (x right, y down, z forward)."""

    object_id: str
    category: str
    part: str
    kind: Literal["revolute", "prismatic"]
    axis_c: tuple[float, float, float]
    """Unit axis; that of a sliding part points along the first motion."""
    pivot_c: tuple[float, float, float]
    """A point on the axis [m]."""
    positions: tuple[float, ...]
    """Joint position at each frame [m or rad]."""
    opening: Literal["opening", "closing", "both"]
    side: Literal["left", "right", "top", "bottom", ""]
    """Edge of the part at which the axis is seen when the part is most closed; empty for a sliding
    part."""
    direction_px: tuple[float, float]
    """Unit vector of the motion of the part's centre in the image during the first stroke."""
    box_px: tuple[float, float, float, float]
    """Left, right, top, bottom of the moving part in the first frame [px]."""
    focal_px: float
    """Focal length [px]."""
    arm: bool
    own_joint: bool
    """The joint is one of the object's."""

    def as_json(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in vars(self).items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedVideo:
    """A video, its truth and what each pixel belongs to."""

    video: Video
    truth: RenderedTruth
    labels: NDArray[np.uint8]
    """Background, moving part, static part or operator at half resolution (T, H/2, W/2)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Joint:
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


def render_operated(
    true: TrueObject,
    seed: int,
    *,
    kind: Literal["revolute", "prismatic"] | None = None,
    conditions: Conditions | None = None,
) -> RenderedVideo | None:
    """Render a video in which one joint of an object is operated.

    Args:
        true: The object.
        seed: Seed of everything that is sampled.
        kind: Joint type; any of the object's if None.
        conditions: Shares of the properties.

    Returns:
        The video, or None if no sampled camera shows the motion well.

    Raises:
        AssetError: The object has no joint of this type.
    """
    rng = np.random.default_rng([seed, *true.object_id.encode()])
    how = conditions or Conditions()
    joint = _sample_joint(rng, true, kind, how)
    n_frames = int(rng.integers(40, 73))
    positions = _sample_positions(rng, joint, n_frames)
    cameras = _sample_cameras(rng, true, joint, positions, how)
    if cameras is None:
        return None
    return _rendered(rng, true, joint, positions, cameras, how)


def _sample_joint(
    rng: np.random.Generator, true: TrueObject, kind: str | None, how: Conditions
) -> _Joint:
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
    return _Joint(
        kind="prismatic" if spec.kind == "prismatic" else "revolute",
        axis=normalised(spec.axis_o),
        pivot=np.asarray(spec.pivot_o, dtype=np.float64),
        lower=lower,
        upper=upper,
        moves=known.moves,
        own=True,
    )


def _other_joint(rng: np.random.Generator, true: TrueObject, kind: str | None) -> _Joint:
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
        return _Joint(
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
    return _Joint(
        kind="revolute",
        axis=np.eye(3)[along],
        pivot=pivot,
        lower=0.0,
        upper=turn,
        moves=moves,
        own=False,
    )


def _sample_positions(rng: np.random.Generator, joint: _Joint, n_frames: int) -> Array:
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


def _sample_cameras(
    rng: np.random.Generator, true: TrueObject, joint: _Joint, positions: Array, how: Conditions
) -> list[Camera] | None:
    """Return one camera for each frame, or None if none shows the motion."""
    scene = PartScene(true.parts)
    low, high = joint_bounds(true.parts)
    box = true.box_of(joint.moves)
    moving = [k for k, part in enumerate(true.parts) if part.name in joint.moves]
    middle = joint.motion(float(np.median(positions)))
    for _ in range(TRIES):
        longest = int(rng.choice([320, 384, 432, 480]))
        ratio = float(rng.choice([4 / 3, 16 / 9]))
        upright = rng.random() < 0.5
        width, height = longest, round(longest / ratio / 2) * 2
        if upright:
            width, height = height, width
        focal = longest * float(np.exp(rng.uniform(np.log(24.0), np.log(70.0)))) / SENSOR_MM
        azimuth = np.radians(rng.uniform(-60.0, 60.0))
        elevation = np.radians(rng.uniform(0.0, 50.0))
        share = float(rng.random())
        at = apply(middle, box.mean(axis=0)) * (1 - share) + 0.5 * (low + high) * share
        small = 0.7 * float(np.linalg.norm(np.ptp(box, axis=0)))
        large = 0.6 * float(np.linalg.norm(high - low))
        radius = float(
            np.exp(rng.uniform(np.log(min(small, large)), np.log(min(2.2 * small, large))))
        )
        distance = radius * 2.0 * focal / min(width, height) * float(rng.uniform(0.75, 1.3))
        away = np.array(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ]
        )
        at = at + 0.12 * radius * rng.standard_normal(3)
        roll = np.radians(rng.normal(0.0, 3.0))
        T_wc = look_at(at + distance * away, at)
        T_wc = T_wc @ pose([0.0, 0.0, 0.0], axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), roll))
        first = pinhole(
            width_px=width,
            height_px=height,
            fovy_rad=2.0 * math.atan(0.5 * height / focal),
            T_wc=T_wc,
        )
        if _shows(scene, first, joint, positions, moving, distance):
            return _moving_camera(rng, first, len(positions), distance, how)
    return None


def _shows(
    scene: PartScene,
    camera: Camera,
    joint: _Joint,
    positions: Array,
    moving: list[int],
    distance: float,
) -> bool:
    """Check that enough of the part and its motion is visible, and that nothing is too near."""
    if camera.eye_w[2] < 0.02 * distance:
        return False
    small = camera.scaled(0.25)
    ends = [int(np.argmin(positions)), int(np.argmax(positions))]
    seen, edge = [], []
    for t in ends:
        poses = np.broadcast_to(np.eye(4), (len(scene.parts), 4, 4)).copy()
        poses[moving] = joint.motion(float(positions[t]))
        found = scene.rasterize(small, poses)
        mine = np.isin(found.part_ids, moving)
        depth = found.depth_m[found.inverse_depth > 0]
        if len(depth) and depth.min() < 0.2 * distance:
            return False
        seen.append(mine.sum())
        edge.append(mine)
    if max(seen) < MIN_AREA * edge[0].size or min(seen) < 0.3 * MIN_AREA * edge[0].size:
        return False
    k = ends[int(np.argmax(seen))]
    rows, columns = np.nonzero(edge[int(np.argmax(seen))])
    poses = np.broadcast_to(np.eye(4), (len(scene.parts), 4, 4)).copy()
    poses[moving] = joint.motion(float(positions[k]))
    depth = scene.rasterize(small, poses).depth_m[rows, columns].astype(np.float64)
    uv = np.stack([columns, rows], axis=-1).astype(np.float64)
    points = small.unproject(uv, depth)
    back = joint.motion(float(positions[k]))
    other = joint.motion(float(positions[ends[0] if k == ends[1] else ends[1]]))
    there, _ = small.project(apply(other @ np.linalg.inv(back), points))
    path = np.linalg.norm(there - uv, axis=1)
    side = max(small.width_px, small.height_px)
    return bool(np.nanpercentile(path, 80) > MIN_PATH * side)


def _moving_camera(
    rng: np.random.Generator, first: Camera, n_frames: int, distance: float, how: Conditions
) -> list[Camera]:
    if rng.random() < how.tripod:
        return [first] * n_frames
    t = np.linspace(0.0, 1.0, n_frames)
    shake = float(np.exp(rng.uniform(np.log(0.002), np.log(0.02))))
    path = np.zeros((n_frames, 6))
    for k in range(6):
        for rate in (1.0, 2.3, 5.1, 9.7):
            phase = rng.uniform(0, 2 * np.pi)
            path[:, k] += (
                shake / rate**0.8 * rng.standard_normal() * np.sin(2 * np.pi * rate * t + phase)
            )
    if rng.random() < 0.35:  # a slow pan or walk
        path += t[:, None] * rng.standard_normal(6) * [0.08, 0.08, 0.03, 0.15, 0.1, 0.1]
    path -= path[0]
    cameras = []
    for row in path:
        angle = float(np.linalg.norm(row[:3]))
        turn = axis_angle_to_matrix(normalised(row[:3]) if angle else np.array([1.0, 0, 0]), angle)
        cameras.append(first.at(first.T_wc @ pose(distance * row[3:] * 0.7, turn)))
    return cameras


def _palm_path(
    rng: np.random.Generator,
    true: TrueObject,
    joint: _Joint,
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


def _sample_shoulder(rng: np.random.Generator, camera: Camera, at: Array) -> Array:
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


def _rendered(
    rng: np.random.Generator,
    true: TrueObject,
    joint: _Joint,
    positions: Array,
    cameras: list[Camera],
    how: Conditions,
) -> RenderedVideo:
    low, high = joint_bounds(true.parts)
    strength = float(np.exp(rng.uniform(np.log(0.04), np.log(0.4))))
    recolour = bool(rng.random() < 0.3)
    tile = float(rng.uniform(0.4, 1.5))
    parts: list[PartMesh] = [
        textured(part, rng, strength, tile, recolour=recolour) for part in true.parts
    ]
    n, n_object = len(positions), len(parts)
    moving = [k for k, part in enumerate(parts) if part.name in joint.moves]
    extra: list[Array] = []  # poses (T, 4, 4) of the parts after the object's
    for part in sample_room(rng, low, high):
        parts.append(part)
        extra.append(np.broadcast_to(np.eye(4), (n, 4, 4)))
    n_static = len(parts)
    has_arm = bool(rng.random() < how.arm)
    if has_arm:
        centre = true.box_of(joint.moves).mean(axis=0)
        shoulder = _sample_shoulder(rng, cameras[0], centre)
        palm, radius = _palm_path(rng, true, joint, positions, cameras[0], shoulder)
        arm: Arm = sample_arm(
            rng, float(np.linalg.norm(palm - shoulder, axis=1).max()) * 1.05, radius
        )
        bend = rng.standard_normal(3) + np.array([0.0, 0.0, -1.0])
        sway = 0.06 * rng.standard_normal(3)
        poses = np.stack(
            [arm.poses(palm[t], shoulder + sway * np.sin(4.0 * t / n), bend) for t in range(n)]
        )
        parts += list(arm.parts)
        extra += [poses[:, k] for k in range(3)]
    if rng.random() < how.person:
        size = float(np.linalg.norm(high - low))
        parts.append(sample_person(rng, size * float(rng.uniform(0.6, 1.3))))
        begin = np.array([rng.uniform(-0.2, 0.8), rng.choice([-1, 1]) * rng.uniform(0.5, 1.2), 0.0])
        walk = np.array([rng.normal(0, 0.2), rng.normal(0, 0.5), 0.0])
        extra.append(pose(size * (begin + np.linspace(0, 1, n)[:, None] * walk)))
    light = Light(
        direction_w=tuple((rng.standard_normal(3) - np.array([0.5, 0, 1.2])).tolist()),
        ambient=float(rng.uniform(0.25, 0.55)),
        directional=float(rng.uniform(0.2, 0.6)),
        head=float(rng.uniform(0.05, 0.35)),
    )
    scene = PartScene(parts, light)

    def poses_at(t: float) -> Array:
        k, s = min(int(t), n - 2), t - min(int(t), n - 2)
        q = float(positions[k] + s * (positions[k + 1] - positions[k]))
        found = np.broadcast_to(np.eye(4), (len(parts), 4, 4)).copy()
        found[moving] = joint.motion(q)
        for j, path in enumerate(extra):
            found[n_object + j] = path[k] if s < 0.5 else path[k + 1]
        return found

    blurred = bool(rng.random() < how.blur)
    frames, labels = [], []
    for t in range(n):
        if blurred:
            exposure = [scene.render_image(cameras[t], poses_at(t + d), samples=1)
                        for d in (0.0, 0.2, 0.4) if t + d <= n - 1]  # fmt: skip
            frames.append(np.mean(exposure, axis=0).astype(np.uint8))
        else:
            fine = scene.render_image(cameras[t].scaled(SUPERSAMPLING), poses_at(t), samples=1)
            shape = (cameras[t].width_px, cameras[t].height_px)
            reduced = cv2.resize(fine, shape, interpolation=cv2.INTER_AREA)
            frames.append(np.asarray(reduced, dtype=np.uint8))
        ids = scene.rasterize(cameras[t].scaled(0.5), poses_at(t)).part_ids
        label = np.where(ids < 0, BACKGROUND, STATIC)
        label[(ids >= n_object) & (ids < n_static)] = BACKGROUND
        label[ids >= n_static] = OPERATOR
        label[np.isin(ids, moving)] = MOVING
        labels.append(label.astype(np.uint8))
    shot = _degraded(rng, np.stack(frames), how)
    fps = float(rng.choice([10.0, 15.0, 24.0, 30.0]))
    truth = _truth(true, joint, positions, cameras[0], parts, moving, has_arm=has_arm)
    return RenderedVideo(
        video=Video(frames=shot, times_s=np.arange(n) / fps), truth=truth, labels=np.stack(labels)
    )


def _degraded(rng: np.random.Generator, frames: Pixels, how: Conditions) -> Pixels:
    """Return frames (T, H, W, 3) with drifting exposure, noise and compression."""
    n = len(frames)
    t = np.linspace(0.0, 1.0, n)
    drift = float(rng.uniform(0.0, 0.12))
    gain = 1.0 + drift * np.sin(2 * np.pi * (rng.uniform(0.3, 2.0) * t + rng.random()))
    sigma = float(rng.choice([0.0, rng.uniform(1.0, 6.0)], p=[0.3, 0.7]))
    jpeg = bool(rng.random() < how.jpeg)
    quality = int(rng.integers(30, 90))
    soft = float(rng.choice([0.0, rng.uniform(0.4, 1.1)]))
    spotlight = _light_field(rng, frames.shape[1:3])
    grain = rng.standard_normal(2 * frames[0].size, dtype=np.float32)
    out = np.empty_like(frames)
    for k, frame in enumerate(frames):
        image = frame.astype(np.float32) * (gain[k] * spotlight[..., None])
        if soft:
            image = cv2.GaussianBlur(image, (0, 0), soft)
        if sigma:
            at = int(rng.integers(grain.size - frame.size))
            image = image + sigma * grain[at : at + frame.size].reshape(frame.shape)
        pixels = np.clip(image, 0, 255).astype(np.uint8)
        if jpeg:
            _, coded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
            pixels = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), dtype=np.uint8)
        out[k] = pixels
    return out


def _light_field(rng: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Return uneven lighting (H, W) around 1."""
    small = (1.0 + 0.15 * rng.standard_normal((3, 3))).astype(np.float32)
    return np.asarray(
        cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC), dtype=np.float32
    )


def _truth(
    true: TrueObject,
    joint: _Joint,
    positions: Array,
    camera: Camera,
    parts: list[PartMesh],
    moving: list[int],
    *,
    has_arm: bool,
) -> RenderedTruth:
    T_cw = camera.T_cw
    points = np.concatenate([parts[k].vertices for k in moving])
    first, _ = camera.project(apply(joint.motion(float(positions[0])), points))
    first = first[np.isfinite(first).all(axis=1)]
    box = (
        float(np.clip(first[:, 0].min(), 0, camera.width_px)),
        float(np.clip(first[:, 0].max(), 0, camera.width_px)),
        float(np.clip(first[:, 1].min(), 0, camera.height_px)),
        float(np.clip(first[:, 1].max(), 0, camera.height_px)),
    )
    span = np.ptp(positions)
    travel = np.abs(positions - positions[0])
    peak = int(np.argmax(travel > 0.9 * travel.max()))
    forward = float(np.sign(positions[peak] - positions[0])) or 1.0
    axis = T_cw[:3, :3] @ joint.axis * (forward if joint.kind == "prismatic" else 1.0)
    pivot = apply(T_cw, joint.pivot)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    path, _ = camera.project(
        np.stack([apply(joint.motion(float(q)), centre) for q in (positions[0], positions[peak])])
    )
    direction = normalised(path[1] - path[0])
    more = abs(positions[peak]) >= abs(positions[0])
    returns = abs(positions[-1] - positions[peak]) > 0.3 * span
    return RenderedTruth(
        object_id=true.object_id,
        category=true.category,
        part=joint.moves[0],
        kind=joint.kind,
        axis_c=(float(axis[0]), float(axis[1]), float(axis[2])),
        pivot_c=(float(pivot[0]), float(pivot[1]), float(pivot[2])),
        positions=tuple(float(q) for q in positions),
        opening="both" if returns else "opening" if more else "closing",
        side=_side(camera, joint, centre, float(positions[np.argmin(np.abs(positions))])),
        direction_px=(float(direction[0]), float(direction[1])),
        box_px=box,
        focal_px=float(camera.fx_px),
        arm=has_arm,
        own_joint=joint.own,
    )


def _side(
    camera: Camera, joint: _Joint, centre: Array, position: float
) -> Literal["left", "right", "top", "bottom", ""]:
    """Return the side of the part at which the axis is seen."""
    if joint.kind == "prismatic":
        return ""
    here = apply(joint.motion(position), centre)
    foot = joint.pivot + joint.axis * float((here - joint.pivot) @ joint.axis)
    step = 0.02 * joint.axis
    uv, _ = camera.project(np.stack([here, foot - step, foot + step]))
    line = normalised(uv[2] - uv[1])
    off = 0.5 * (uv[1] + uv[2]) - uv[0]
    off = off - line * float(off @ line)
    if not np.isfinite(off).all():
        return ""
    if abs(off[0]) >= abs(off[1]):
        return "left" if off[0] < 0 else "right"
    return "top" if off[1] < 0 else "bottom"
