"""Evidence: what an actor is given of an object, and nothing else.

Parts come under neutral names in an order drawn anew for each object, as triangles in one frame.
No file name, id, joint or origin of the data set is in it. Labels are the semantic names, without
the words that would tell a joint.
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

PROBES = 7
"""Frames of a clip at which it is measured how far the part moves in the picture."""
MOST_POINTS = 2000


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One question to an actor, and what only the benchmark knows of it."""

    name: str
    """Unique in the object: the true link that moves, or ``all``."""
    evidence: Evidence
    names: Mapping[str, str]
    """True name of each part, by its neutral one."""
    joints: tuple[TrueJoint, ...]
    """True joints that are asked for."""
    moved_px: float | None = None
    """How far a point that is seen moves in the picture; None without a clip."""
    visible_px: Mapping[str, int] | None = None
    """Pixels of each part in the picture, by true name; None without one."""


def cases_of(subject: TrueObject, config: BenchmarkConfig) -> Iterator[Case]:
    """The questions about one object: one for each joint with clips, else one for all joints."""
    rng = np.random.default_rng([config.seed, zlib.crc32(subject.object_id.encode())])
    order = rng.permutation(len(subject.parts))
    names = {f"part_{i:02d}": subject.parts[k].name for i, k in enumerate(order)}
    placed = config.task == "joints"
    parts = tuple(
        _given(subject.part(true), neutral, placed=placed) for neutral, true in names.items()
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
    told = camera_off(camera, subject, rng) if config.condition == "camera_off" else camera
    base = replace(base, camera=told)
    shown = subject.parts
    if config.condition == "noisy":
        shown = tuple(textured(part, rng) for part in shown)
    scene = PartScene(shown)
    if config.modality == "image":
        picture = _disturbed(scene.render_image(camera)[None], config, rng)[0]
        seen = np.bincount(scene.rasterize(camera).part_ids.ravel() + 1, minlength=len(shown) + 1)[1:]
        yield Case(
            name="all",
            evidence=replace(base, image=picture),
            names=names,
            joints=subject.joints,
            visible_px={part.name: int(n) for part, n in zip(shown, seen, strict=True)},
        )
        return
    for joint in subject.joints:
        yield _clip_case(subject, joint, scene, camera, base, names, config, rng)


def _clip_case(
    subject: TrueObject,
    joint: TrueJoint,
    scene: PartScene,
    camera: Camera,
    base: Evidence,
    names: Mapping[str, str],
    config: BenchmarkConfig,
    rng: np.random.Generator,
) -> Case:
    """A clip in which one joint goes from end to end."""
    q = sweep_positions(joint.joint.lower, joint.joint.upper, config.n_frames)
    moving = [i for i, part in enumerate(subject.parts) if part.name in joint.moves]
    poses = poses_of_parts(len(subject.parts), moving, joint.joint.T_o(q))
    frames = np.stack([scene.render_image(camera, T) for T in poses])
    evidence = replace(
        base,
        video=_disturbed(frames, config, rng),
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
    """How far the point that moves farthest in the picture moves, of those seen at some time.

    Args:
        scene: The parts.
        camera: Where from.
        poses: What is done to each part at each frame (T, P, 4, 4).
        moving: Indices of the parts that move together.
    """
    motion = poses[:, moving[0]]
    probes = np.unique(np.linspace(0, len(poses) - 1, PROBES).round().astype(int))
    farthest = 0.0
    for t in probes:
        seen = scene.rasterize(camera, poses[t])
        v, u = np.nonzero(np.isin(seen.part_ids, moving))
        if not len(v):
            continue
        pick = np.linspace(0, len(v) - 1, min(len(v), MOST_POINTS)).round().astype(int)
        uv = np.stack([u[pick], v[pick]], axis=-1)
        points = camera.unproject(uv, seen.depth_m[v[pick], u[pick]])
        at_zero = apply(inverse(motion[t]), points)
        way, _ = camera.project(apply(motion[probes][:, None], at_zero))
        farthest = max(farthest, float(np.nanmax(np.linalg.norm(way - uv, axis=-1), initial=0.0)))
    return farthest


def _given(part: PartMesh, name: str, *, placed: bool) -> PartMesh:
    neutral = part.renamed(name)
    return neutral if placed else neutral.moved(pose(-part.centre))


def _disturbed(frames: Pixels, config: BenchmarkConfig, rng: np.random.Generator) -> Pixels:
    return noisy_frames(frames, rng) if config.condition == "noisy" else frames
