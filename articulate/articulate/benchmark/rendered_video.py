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

from articulate.benchmark.operated_joint import (
    Conditions,
    OperatedJoint,
    palm_path,
    sample_joint,
    sample_positions,
    sample_shoulder,
)
from articulate.benchmark.surroundings import (
    Arm,
    sample_arm,
    sample_person,
    sample_room,
    textured,
)
from articulate.benchmark.truth import TrueObject
from articulate.render.camera import Camera, look_at, pinhole
from articulate.render.joint_video import Video
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.raster import Pixels
from articulate.render.rendered_photo import sample_camera
from articulate.render.scene import Light, PartScene
from articulate.transforms import Array, apply, axis_angle_to_matrix, normalised, pose

BACKGROUND, MOVING, STATIC, OPERATOR = 0, 1, 2, 3
"""Values of ``RenderedVideo.labels``."""
SENSOR_MM = 36.0
"""Width of the sensor that equivalent focal lengths refer to [mm]."""
SUPERSAMPLING = 1.4
"""Scale at which frames are rendered before they are reduced."""
EXPOSURE = (0.0, 0.2, 0.4)
"""Times at which a blurred frame is rendered, as a share of the frame time."""
TRIES = 14
"""Cameras that are sampled until the motion is well visible."""
MIN_PATH = 0.09
"""Least motion of a visible point of the part, as a share of the longest side."""
MIN_AREA = 0.02
"""Least visible area of the moving part, as a share of the image."""


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
    joint = sample_joint(rng, true, kind, how)
    n_frames = int(rng.integers(40, 73))
    positions = sample_positions(rng, joint, n_frames)
    cameras = _sample_cameras(rng, true, joint, positions, how)
    if cameras is None:
        return None
    return _rendered(rng, true, joint, positions, cameras, how)


def _sample_cameras(
    rng: np.random.Generator,
    true: TrueObject,
    joint: OperatedJoint,
    positions: Array,
    how: Conditions,
) -> list[Camera] | None:
    """Return one camera for each frame, or None if none shows the motion."""
    scene = PartScene(true.parts)
    low, high = joint_bounds(true.parts)
    box = true.box_of(joint.moves)
    moving = [k for k, part in enumerate(true.parts) if part.name in joint.moves]
    middle = joint.motion(float(np.median(positions)))
    for _ in range(TRIES):
        if how.entire:
            first = sample_camera(true.parts, rng)
            distance = float(np.linalg.norm(first.eye_w - 0.5 * (low + high)))
        else:
            at = apply(middle, box.mean(axis=0))
            first, distance = _near_view(rng, at, np.ptp(box, axis=0), low, high)
        if _shows(scene, first, joint, positions, moving, distance):
            return _moving_camera(rng, first, len(positions), distance, how)
    return None


def _near_view(
    rng: np.random.Generator, part: Array, size: Array, low: Array, high: Array
) -> tuple[Camera, float]:
    """Return a camera that shows a part or all of the object, and its distance [m].

    Args:
        rng: Random numbers.
        part: Centre of the part (3,).
        size: Sides of its box (3,).
        low: Lowest corner of the object (3,).
        high: Highest corner of the object (3,).
    """
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
    at = part * (1 - share) + 0.5 * (low + high) * share
    small = 0.7 * float(np.linalg.norm(size))
    large = 0.6 * float(np.linalg.norm(high - low))
    radius = float(np.exp(rng.uniform(np.log(min(small, large)), np.log(min(2.2 * small, large)))))
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
    return first, distance


def _shows(
    scene: PartScene,
    camera: Camera,
    joint: OperatedJoint,
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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stage:
    """All parts of the scene: the object's, then the room's, then the operator's."""

    parts: list[PartMesh]
    moving: list[int]
    """Indices of the moving parts."""
    n_object: int
    """Number of the object's parts."""
    n_static: int
    """Number of parts before the operator's."""
    paths: list[Array]
    """Poses (T, 4, 4) of each part after the object's."""
    joint: OperatedJoint
    positions: Array
    arm: bool

    def poses(self, t: float) -> Array:
        """Return the poses of all parts (P, 4, 4) at a time in frames."""
        k = min(int(t), len(self.positions) - 2)
        s = t - k
        q = float(self.positions[k] + s * (self.positions[k + 1] - self.positions[k]))
        found = np.broadcast_to(np.eye(4), (len(self.parts), 4, 4)).copy()
        found[self.moving] = self.joint.motion(q)
        for j, path in enumerate(self.paths):
            found[self.n_object + j] = path[k] if s < 0.5 else path[k + 1]
        return found


def _sample_stage(
    rng: np.random.Generator,
    true: TrueObject,
    joint: OperatedJoint,
    positions: Array,
    camera: Camera,
    how: Conditions,
) -> _Stage:
    low, high = joint_bounds(true.parts)
    strength = float(np.exp(rng.uniform(np.log(0.04), np.log(0.4))))
    recolour = bool(rng.random() < 0.3)
    tile = float(rng.uniform(0.4, 1.5))
    parts = [textured(part, rng, strength, tile, recolour=recolour) for part in true.parts]
    n, n_object = len(positions), len(parts)
    moving = [k for k, part in enumerate(parts) if part.name in joint.moves]
    paths: list[Array] = []
    for part in sample_room(rng, low, high):
        parts.append(part)
        paths.append(np.broadcast_to(np.eye(4), (n, 4, 4)))
    n_static = len(parts)
    has_arm = bool(rng.random() < how.arm)
    if has_arm:
        shoulder = sample_shoulder(rng, camera, true.box_of(joint.moves).mean(axis=0))
        palm, radius = palm_path(rng, true, joint, positions, camera, shoulder)
        reach = float(np.linalg.norm(palm - shoulder, axis=1).max()) * 1.05
        arm: Arm = sample_arm(rng, reach, radius)
        bend = rng.standard_normal(3) + np.array([0.0, 0.0, -1.0])
        sway = 0.06 * rng.standard_normal(3)
        poses = np.stack(
            [arm.poses(palm[t], shoulder + sway * np.sin(4.0 * t / n), bend) for t in range(n)]
        )
        parts += list(arm.parts)
        paths += [poses[:, k] for k in range(3)]
    if rng.random() < how.person:
        size = float(np.linalg.norm(high - low))
        parts.append(sample_person(rng, size * float(rng.uniform(0.6, 1.3))))
        begin = np.array([rng.uniform(-0.2, 0.8), rng.choice([-1, 1]) * rng.uniform(0.5, 1.2), 0.0])
        walk = np.array([rng.normal(0, 0.2), rng.normal(0, 0.5), 0.0])
        paths.append(pose(size * (begin + np.linspace(0, 1, n)[:, None] * walk)))
    return _Stage(
        parts=parts,
        moving=moving,
        n_object=n_object,
        n_static=n_static,
        paths=paths,
        joint=joint,
        positions=positions,
        arm=has_arm,
    )


def _rendered(
    rng: np.random.Generator,
    true: TrueObject,
    joint: OperatedJoint,
    positions: Array,
    cameras: list[Camera],
    how: Conditions,
) -> RenderedVideo:
    stage = _sample_stage(rng, true, joint, positions, cameras[0], how)
    direction = rng.standard_normal(3) - np.array([0.5, 0, 1.2])
    light = Light(
        direction_w=(float(direction[0]), float(direction[1]), float(direction[2])),
        ambient=float(rng.uniform(0.25, 0.55)),
        directional=float(rng.uniform(0.2, 0.6)),
        head=float(rng.uniform(0.05, 0.35)),
    )
    scene = PartScene(stage.parts, light)
    blurred = bool(rng.random() < how.blur)
    frames, labels = [], []
    for t, camera in enumerate(cameras):
        frames.append(_frame(scene, camera, stage, t, blurred=blurred))
        ids = scene.rasterize(camera.scaled(0.5), stage.poses(t)).part_ids
        label = np.where(ids < 0, BACKGROUND, STATIC)
        label[(ids >= stage.n_object) & (ids < stage.n_static)] = BACKGROUND
        label[ids >= stage.n_static] = OPERATOR
        label[np.isin(ids, stage.moving)] = MOVING
        labels.append(label.astype(np.uint8))
    degraded = _degraded(rng, np.stack(frames), how)
    fps = float(rng.choice([10.0, 15.0, 24.0, 30.0]))
    return RenderedVideo(
        video=Video(frames=degraded, times_s=np.arange(len(frames)) / fps),
        truth=_truth(true, stage, cameras[0]),
        labels=np.stack(labels),
    )


def _frame(scene: PartScene, camera: Camera, stage: _Stage, t: int, *, blurred: bool) -> Pixels:
    """Return one frame (H, W, 3), blurred over the exposure time or supersampled."""
    if blurred:
        times = [t + d for d in EXPOSURE if t + d <= len(stage.positions) - 1]
        exposure = [scene.render_image(camera, stage.poses(at), samples=1) for at in times]
        return np.asarray(np.mean(exposure, axis=0).astype(np.uint8))
    fine = scene.render_image(camera.scaled(SUPERSAMPLING), stage.poses(t), samples=1)
    size = (camera.width_px, camera.height_px)
    reduced = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
    return np.asarray(reduced, dtype=np.uint8)


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


def _truth(true: TrueObject, stage: _Stage, camera: Camera) -> RenderedTruth:
    joint, positions = stage.joint, stage.positions
    T_cw = camera.T_cw
    points = np.concatenate([stage.parts[k].vertices for k in stage.moving])
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
        arm=stage.arm,
        own_joint=joint.own,
    )


def _side(
    camera: Camera, joint: OperatedJoint, centre: Array, position: float
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
