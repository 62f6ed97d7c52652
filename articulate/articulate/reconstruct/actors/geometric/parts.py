"""Relations of parts: which may move, which move along, which holds the moving one, what remains.

The parent of a part touches it along its travel. A part that is only beside it at rest, or
mounted on it, does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from articulate.geometry.shapes import sample_surface
from articulate.reconstruct.actors.geometric.compositing import rasterize
from articulate.reconstruct.actors.geometric.image_pyramid import (
    PyramidLevel,
    VideoScene,
    build_scene,
    refit_light,
)
from articulate.reconstruct.actors.geometric.parameters import IMAGE, PARTS
from articulate.reconstruct.actors.geometric.search import MotionFit
from articulate.reconstruct.actors.geometric.surface import JointMotion
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints, apply


def rank_parts(level: PyramidLevel) -> list[int]:
    """Return the parts with changes in their image, most first."""
    ids = _seen_ids(level)
    total = max(1, int(level.change.sum()))
    scores: list[tuple[float, int]] = []
    for part in np.unique(level.surface.part_ids):
        mask = cv2.dilate((ids == part).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
        mask = mask if mask.any() else _unoccluded_mask(level, int(part))
        inside = float((mask & level.change).sum())
        if inside > 0:
            scores.append((inside / total * np.sqrt(inside / float(mask.sum())), int(part)))
    return [part for _, part in sorted(scores, reverse=True)]


def part_in_place(level: PyramidLevel, *, all_over: bool = True) -> int | None:
    """Return the part whose image at rest contains nearly all changes, such as a knob.

    Args:
        level: Resolution at which the images are compared.
        all_over: The changes must extend over most of the part; otherwise the part must be small.
    """
    ids = _seen_ids(level)
    total = max(1, int(level.change.sum()))
    for part in np.unique(ids[ids >= 0]):
        mask = cv2.dilate((ids == part).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
        inside = mask & level.change
        if float(inside.sum()) >= (
            PARTS.in_place_share if all_over else PARTS.partly_in_place_share
        ) * total and (
            _spans(level, int(part), inside) if all_over else _is_small(level, int(part))
        ):
            return int(part)
    return None


def _spans(level: PyramidLevel, part: int, inside: NDArray[np.bool_]) -> bool:
    """Return whether the changes extend over most of ``part`` in the image, occluded or not."""
    spots = level.crop.project(level.surface.only([part]).points_o)
    rows, columns = np.nonzero(inside)
    changed = np.array([np.ptp(columns), np.ptp(rows)]) + 1.0
    return bool((changed >= PARTS.span_share * np.ptp(spots, axis=0)).all())


def _is_small(level: PyramidLevel, part: int) -> bool:
    """Return whether ``part`` is small compared with the object."""
    own, all_ = (np.ptp(s.points_o, axis=0) for s in (level.surface.only([part]), level.surface))
    return bool(np.prod(own) <= PARTS.small_volume_share * np.prod(all_))


def hidden_parts(level: PyramidLevel) -> list[int]:
    """Return the parts that are hidden at rest, by distance to the changes, closest first.

    A rack in an oven or a drawer under a table top is visible only when it is out.
    """
    ids = _seen_ids(level)
    off_px = cv2.distanceTransform((~level.change).astype(np.uint8), cv2.DIST_L2, 3)
    found = []
    for part in np.unique(level.surface.part_ids):
        mask = _unoccluded_mask(level, int(part))
        if mask.any() and not (ids == part).any():
            found.append((float(off_px[mask].min()), int(part)))
    return [part for _, part in sorted(found)]


def _seen_ids(level: PyramidLevel) -> Ints:
    """Return the part of each pixel at rest (H, W), -1 for background."""
    seen = rasterize(level.surface, level.crop)
    return np.where(seen.face_ids >= 0, level.surface.part_ids[seen.face_ids], -1)


def _unoccluded_mask(level: PyramidLevel, part: int) -> NDArray[np.bool_]:
    """Return the mask of ``part`` (H, W) as if nothing else existed."""
    return np.asarray(rasterize(level.surface.only([part]), level.crop).face_ids >= 0)


def add_comoving_parts(scene: VideoScene, fit: MotionFit) -> MotionFit:
    """Add the smaller parts that move along, such as a handle on a door.

    Args:
        scene: The video and the object.
        fit: The motion, with positions in every frame of the video.
    """
    longest = [float(np.ptp(part.bounds, axis=0).max()) for part in scene.parts]
    others = [k for k in range(len(scene.parts)) if k not in fit.parts]
    small = [k for k in others if longest[k] < longest[fit.parts[0]]]
    moving = _points(scene, fit.parts)
    gaps = {k: gap_m(surface_points(scene.parts[k]), moving) for k in small}
    near = [k for k in small if gaps[k] <= PARTS.near_share * scene.size_m]
    if not near:
        return fit
    rest = _points(scene, [k for k in others if k not in near])
    level = scene.level(IMAGE.fine_px, IMAGE.fine_frames)
    here = replace(fit, q=fit.q[level.crop.indices])
    level = replace(level, light=refit_light(level, here, level.crop))
    static_cost = _motion_cost(level, here)
    joined = []
    for k in near:
        moving_cost = _motion_cost(level, replace(here, parts=(*here.parts, k)))
        saved = (static_cost - moving_cost) / max(level.compositing([k]).own_px, 1)
        if abs(saved) < PARTS.decisive_cost:
            away = gap_m(surface_points(scene.parts[k]), rest) if len(rest) else 0.0
            saved = away - gaps[k] - PARTS.closer_share * scene.size_m
        if saved > 0.0:
            joined.append(k)
    return replace(fit, parts=(*fit.parts, *joined))


def _points(scene: VideoScene, parts: Sequence[int]) -> Array:
    """Return points (P, 3) on the surfaces of ``parts``."""
    return np.concatenate([np.zeros((0, 3)), *(surface_points(scene.parts[k]) for k in parts)])


def _motion_cost(level: PyramidLevel, fit: MotionFit) -> float:
    """Return the image cost if exactly the parts of ``fit`` move."""
    return float(level.compositing(fit.parts).path_cost(fit.motion.T_o(fit.q)).sum())


def find_parent(
    part: PartMesh, still: Sequence[PartMesh], motion: JointMotion, q: Array
) -> str | None:
    """Return the name of the part that holds ``part``, None if nothing is static.

    Of the static parts that stay as close to it along its travel as any does, the one whose box is
    closest to its centre.

    Args:
        part: The moving part, at position 0.
        still: The static parts.
        motion: Its motion.
        q: Positions that it reaches (N,) [m or rad].
    """
    if len(still) < 2:
        return still[0].name if still else None
    bounds = np.concatenate([other.bounds for other in (part, *still)])
    size_m = float(np.linalg.norm(np.ptp(bounds, axis=0)))
    own, T_o = surface_points(part), motion.T_o(np.linspace(q.min(), q.max(), PARTS.states))
    moved = [apply(T, own) for T in T_o]
    gaps = [max(gap_m(points, surface_points(other)) for points in moved) for other in still]
    near = [k for k, gap in enumerate(gaps) if gap <= min(gaps) + PARTS.equal_gap_share * size_m]
    return still[min(near, key=lambda k: _off(part, still[k]))].name


def gap_m(points: Array, others: Array) -> float:
    """Return the distance of two parts sampled at ``points`` (P, 3) and ``others`` (Q, 3) [m]."""
    return float(np.percentile(cKDTree(others).query(points)[0], PARTS.touching_percent))


def _off(part: PartMesh, other: PartMesh) -> float:
    """Return the distance of the centre of ``part`` to the box of ``other`` [m].

    The distance of the centres breaks ties.
    """
    low, high = other.bounds
    middle = part.centre
    beside = float(np.linalg.norm(middle - np.clip(middle, low, high)))
    return beside + 1e-3 * float(np.linalg.norm(middle - other.centre))


def surface_points(part: PartMesh) -> Array:
    """Return points (P, 3) on the surface of ``part``; its vertices if it has no area."""
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    if mesh.area <= 0.0:
        return part.vertices
    return sample_surface(mesh, PARTS.points)[0]


def residual_evidence(evidence: Evidence, prediction: Prediction) -> Evidence | None:
    """Remove the motion that ``prediction`` explains; None if little else moves.

    Where the moving part passes, the video is frozen at its first frame; if enough still changes,
    another joint moves, at the same time or before or after. A motion that passes before or behind
    the first part in the image is lost.
    """
    moving = [joint for joint in prediction.joints if joint.kind != "fixed"]
    if not moving or evidence.video is None or evidence.camera is None or not evidence.placed:
        return None
    scene = build_scene(evidence.video, evidence.camera, evidence.parts)
    swept = np.zeros(scene.change.shape, dtype=np.bool_)
    for joint in moving:
        swept |= _swept(scene, joint, prediction)
    left = cv2.morphologyEx(
        (scene.change & ~swept).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3))
    )
    if left.sum() < max(PARTS.min_residual_px, PARTS.min_residual_share * scene.change.sum()):
        return None
    video = evidence.video.copy()
    video[:, swept] = video[0][swept]
    return replace(evidence, video=video)


def _swept(scene: VideoScene, joint: PredictedJoint, prediction: Prediction) -> NDArray[np.bool_]:
    """Return the mask (H, W) that the part of ``joint`` and its attachments sweep."""
    names = [part.name for part in scene.parts]
    fixed = [j.part for j in prediction.joints if j.kind == "fixed" and j.parent == joint.part]
    parts = [names.index(name) for name in (joint.part, *fixed)]
    height, width = scene.change.shape
    level = replace(scene, box=(0, width, 0, height)).level(PARTS.swept_px, 2)
    surface = level.surface.only(parts)
    low = 0.0 if joint.lower is None else joint.lower
    high = low + 2.0 * np.pi if joint.upper is None else joint.upper
    seen = np.zeros(level.crop.size, dtype=np.uint8)
    for T_o in joint.T_o(np.linspace(low, high, PARTS.swept_poses)):
        seen |= (rasterize(surface, level.crop, T_o).face_ids >= 0).astype(np.uint8)
    seen = np.asarray(
        cv2.dilate(seen, np.ones((2 * PARTS.swept_margin_px + 1, 2 * PARTS.swept_margin_px + 1))),
        dtype=np.uint8,
    )
    return np.asarray(
        cv2.resize(seen, (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.bool_
    )
