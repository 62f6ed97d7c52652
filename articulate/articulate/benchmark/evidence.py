"""Evidence of benchmark cases: everything that an actor may use.

Parts have neutral names in a random order for each object, and are triangles in one frame. Evidence
contains no file name, id, joint or origin of the data set. Labels are the semantic names without
words that would reveal a joint. An image shows all joints open, each at a random share of its
range, because people photograph an object in a state that shows how it opens.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.perturb import camera_off, noisy_frames, textured
from articulate.benchmark.truth import TrueJoint, TrueObject
from articulate.formats.part_names import plain_label
from articulate.reconstruct.actors.protocol import Evidence
from articulate.render.camera import Camera, front_camera
from articulate.render.joint_video import poses_of_parts, sweep_positions
from articulate.render.parts import PartMesh
from articulate.render.raster import Pixels
from articulate.render.scene import PartScene
from articulate.transforms import Array, apply, inverse, pose

OPEN_SHARES = (0.2, 0.8)
"""Least and largest share of its range at which a joint is in an image."""
MOTION_FRAMES = 7
"""Frames of a video in which the motion in the image is measured."""
MAX_POINTS = 2000


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Evidence for an actor, with the truth that only the benchmark uses."""

    name: str
    """Name within the object: the true link that moves, or ``all``."""
    evidence: Evidence
    names: Mapping[str, str]
    """True name of each part by its neutral name."""
    joints: tuple[TrueJoint, ...]
    """True joints of the case."""
    moved_px: float | None = None
    """Largest motion of a visible point in the image [px]; None without a video."""
    visible_px: Mapping[str, int] | None = None
    """Pixels of each part in the image, by true name; None without an image."""


def cases_of(subject: TrueObject, config: BenchmarkConfig) -> Iterator[Case]:
    """Yield the cases of an object: one for each joint with videos, else one for all joints."""
    rng = np.random.default_rng([config.seed, zlib.crc32(subject.object_id.encode())])
    order = rng.permutation(len(subject.parts))
    names = {f"part_{i:02d}": subject.parts[k].name for i, k in enumerate(order)}
    placed = config.task == "joints"
    parts = tuple(
        _neutral(subject.part(true), neutral, placed=placed) for neutral, true in names.items()
    )
    base = Evidence(
        modality=config.modality,
        parts=parts,
        labels={neutral: plain_label(subject.labels[true]) for neutral, true in names.items()},
        placed=placed,
        seed=int(rng.integers(2**31)),
    )
    if config.modality == "text":
        yield Case(name="all", evidence=base, names=names, joints=subject.joints)
        return
    camera = front_camera(config.width_px, config.height_px)
    evidence_camera = (
        camera_off(camera, subject, rng) if config.condition == "camera_off" else camera
    )
    base = replace(base, camera=evidence_camera)
    parts = subject.parts
    if config.condition == "noisy":
        parts = tuple(textured(part, rng) for part in parts)
    scene = PartScene(parts)
    if config.modality == "image":
        closed = config.task == "placement" or config.image_state == "closed"
        poses = None if closed else open_poses(subject, rng)
        image = _perturbed(scene.render_image(camera, poses)[None], config, rng)[0]
        ids = scene.rasterize(camera, poses).part_ids.ravel()
        pixels = np.bincount(ids + 1, minlength=len(parts) + 1)[1:]
        yield Case(
            name="all",
            evidence=replace(base, image=image),
            names=names,
            joints=subject.joints,
            visible_px={part.name: int(n) for part, n in zip(parts, pixels, strict=True)},
        )
        return
    for joint in subject.joints:
        yield _video_case(subject, joint, scene, camera, base, names, config, rng)


def open_poses(subject: TrueObject, rng: np.random.Generator) -> Array:
    """Sample the motion of each part (P, 4, 4), all joints open.

    Each joint is at 20 to 80 % of the travel from 0, or the limit closest to it, to its farther
    limit; a joint without limits at that share of a turn.
    """
    poses = np.broadcast_to(np.eye(4), (len(subject.parts), 4, 4)).copy()
    # A joint that moves more parts is nearer to the root, and its motion is applied last.
    for joint in sorted(subject.joints, key=lambda joint: len(joint.moves)):
        limits = [q for q in (joint.joint.lower, joint.joint.upper) if q is not None]
        end = max(limits, key=abs, default=2.0 * np.pi)
        start = float(np.clip(0.0, min(limits), max(limits))) if limits else 0.0
        T_o = joint.joint.T_o(start + (end - start) * rng.uniform(*OPEN_SHARES))
        for k, part in enumerate(subject.parts):
            if part.name in joint.moves:
                poses[k] = T_o @ poses[k]
    return poses


def _video_case(
    subject: TrueObject,
    joint: TrueJoint,
    scene: PartScene,
    camera: Camera,
    base: Evidence,
    names: Mapping[str, str],
    config: BenchmarkConfig,
    rng: np.random.Generator,
) -> Case:
    """Render a video in which one joint moves from limit to limit."""
    q = sweep_positions(joint.joint.lower, joint.joint.upper, config.n_frames)
    moving = [i for i, part in enumerate(subject.parts) if part.name in joint.moves]
    poses = poses_of_parts(len(subject.parts), moving, joint.joint.T_o(q))
    frames = np.stack([scene.render_image(camera, T) for T in poses])
    evidence = replace(
        base,
        video=_perturbed(frames, config, rng),
        times_s=np.arange(config.n_frames) / config.fps,
    )
    return Case(
        name=joint.joint.part,
        evidence=evidence,
        names=names,
        joints=(joint,),
        moved_px=motion_px(scene, camera, poses, moving),
    )


def motion_px(scene: PartScene, camera: Camera, poses: Array, moving: list[int]) -> float:
    """Return the largest motion in the image [px] of a point that is visible at some time.

    Args:
        scene: The parts.
        camera: Camera of the video.
        poses: Motion of each part in each frame (T, P, 4, 4).
        moving: Indices of the parts that move together.
    """
    motion = poses[:, moving[0]]
    frames = np.unique(np.linspace(0, len(poses) - 1, MOTION_FRAMES).round().astype(int))
    farthest = 0.0
    for t in frames:
        buffers = scene.rasterize(camera, poses[t])
        v, u = np.nonzero(np.isin(buffers.part_ids, moving))
        if not len(v):
            continue
        pick = np.linspace(0, len(v) - 1, min(len(v), MAX_POINTS)).round().astype(int)
        uv = np.stack([u[pick], v[pick]], axis=-1)
        points = camera.unproject(uv, buffers.depth_m[v[pick], u[pick]])
        at_zero = apply(inverse(motion[t]), points)
        moved_uv, _ = camera.project(apply(motion[frames][:, None], at_zero))
        farthest = max(
            farthest, float(np.nanmax(np.linalg.norm(moved_uv - uv, axis=-1), initial=0.0))
        )
    return farthest


def _neutral(part: PartMesh, name: str, *, placed: bool) -> PartMesh:
    neutral = part.renamed(name)
    return neutral if placed else neutral.moved(pose(-part.centre))


def _perturbed(frames: Pixels, config: BenchmarkConfig, rng: np.random.Generator) -> Pixels:
    return noisy_frames(frames, rng) if config.condition == "noisy" else frames
