"""Link placement: whether each part was put where it belongs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from articulate.benchmark.protocols import ANGLE_RAD, LENGTH, Protocol
from articulate.render.parts import PartMesh
from articulate.transforms import Array, matrix_to_quat, rotation_angle

ALIKE = 0.01
"""Parts whose boxes differ by less than this share of their size are interchangeable."""


@dataclass(frozen=True, kw_only=True)
class PlacementErrors:
    """How far each part of the truth is from where it belongs, parts in the order of the truth."""

    position: Array
    """Distance of the middles of the boxes (P,) [units]; infinite for a part not placed."""
    angle_rad: Array
    """Angle by which each part is turned wrongly (P,); pi for a part not placed."""
    visible_px: Array
    """Pixels of each part in the picture (P,); NaN where there is no picture."""
    shift: Array
    """What was taken off all positions (3,) before they were compared; zero if anchored."""
    said: Array
    """Where each part was put (P, 3), before any part stood for another."""
    quat: Array
    """How each was turned (P, 4), wxyz."""
    chosen: NDArray[np.intp]
    """Index of the part that stands for each (P,); parts alike may change places."""

    @property
    def right(self) -> Array:
        """Whether each part is within both thresholds (P,), as ``strict`` asks."""
        return np.asarray((self.position <= LENGTH) & (self.angle_rad <= ANGLE_RAD))


def placement_errors(
    parts: Sequence[PartMesh],
    labels: Mapping[str, str],
    placements: Mapping[str, Array],
    *,
    anchored: bool,
    visible_px: Array | None = None,
) -> PlacementErrors:
    """Errors of a placement.

    Parts that look alike and are called alike may stand for each other: which one is meant is
    chosen so that the sum of distances is smallest, each part for one.

    Args:
        parts: The true parts, in ``o``, in their places.
        labels: What each is called, as the actor was told.
        placements: ``T_op`` (4, 4) of each part by name, from the part with the middle of its box
            at the origin.
        anchored: Positions in ``o`` can be known, as with a camera; else the largest part's place
            is taken as right, and the others count against it.
        visible_px: Pixels of each part in the picture (P,).
    """
    n = len(parts)
    centres = np.stack([part.centre for part in parts])
    said, angles = np.full((n, 3), np.inf), np.full(n, np.pi)
    quats = np.full((n, 4), np.nan)
    for i, part in enumerate(parts):
        T = placements.get(part.name)
        if T is not None and np.shape(T) == (4, 4) and np.isfinite(T).all():
            said[i] = np.asarray(T)[:3, 3]
            angles[i] = rotation_angle(np.asarray(T, dtype=np.float64)[:3, :3])
            quats[i] = matrix_to_quat(np.asarray(T, dtype=np.float64)[:3, :3])
    largest = int(np.argmax([float(np.prod(np.ptp(p.bounds, axis=0))) for p in parts]))
    shift = np.zeros(3)
    if not anchored and np.isfinite(said[largest]).all():
        shift = said[largest] - centres[largest]
        said = said - shift
    chosen = _assigned(parts, labels, centres, said)
    return PlacementErrors(
        position=np.linalg.norm(said[chosen] - centres, axis=1),
        angle_rad=angles[chosen],
        visible_px=np.full(n, np.nan) if visible_px is None else visible_px,
        shift=shift,
        said=said,
        quat=quats,
        chosen=chosen,
    )


def _assigned(
    parts: Sequence[PartMesh], labels: Mapping[str, str], centres: Array, said: Array
) -> NDArray[np.intp]:
    """Index of the placed part that stands for each true one (P,)."""
    far, nothing = 1e6, 1e-6
    size = np.stack([np.ptp(part.bounds, axis=0) for part in parts])
    alike = np.abs(size[:, None] - size[None]).max(axis=-1) <= ALIKE * size.max(axis=-1)[:, None]
    named = np.array([labels.get(part.name, "") for part in parts])
    same = alike & (named[:, None] == named[None])
    np.fill_diagonal(same, True)
    distance = np.linalg.norm(said[None] - centres[:, None], axis=-1)
    cost = np.where(same, np.minimum(np.nan_to_num(distance, posinf=far), far), 1e3 * far)
    cost += nothing * (1.0 - np.eye(len(parts)))  # of equals, each part stands for itself
    return np.asarray(linear_sum_assignment(cost)[1])


def placement_success(errors: PlacementErrors) -> dict[Protocol, bool]:
    """Whether an object's placement is right, by protocol.

    The publication takes the mean of distance and angle over all parts against 0.05. Its code
    does the same over parts found by name, each against the nearest of that name, which
    :func:`released_placement` computes; ``strict`` wants every part right.
    """
    mean = float(np.mean(0.5 * (errors.position + errors.angle_rad)))
    return {"paper": mean < LENGTH, "strict": bool(errors.right.all())}


def released_placement(
    truth: Mapping[str, tuple[Array, Array]], predicted: Mapping[str, tuple[Array, Array]]
) -> bool:
    """Success of a placement in the released code.

    Args:
        truth: Middle of the box (3,) and quaternion wxyz (4,) of each part, by its semantic name.
        predicted: The same of what was predicted.

    Only names that both know count, and where there is none the error is 0. Each is compared with
    the nearest predicted part whose name begins with the same word, which may serve several.
    """
    positions, angles = [], []
    for name in sorted(set(truth) & set(predicted)):
        centre, quat = truth[name]
        word = name.split("_")[0]
        near = min(
            (other for other in predicted if other.startswith(word)),
            key=lambda other: float(np.linalg.norm(predicted[other][0] - centre)),
        )
        positions.append(float(np.linalg.norm(predicted[near][0] - centre)))
        with np.errstate(invalid="ignore"):  # not clipped there either
            angles.append(float(2.0 * np.arccos(np.abs(np.sum(quat * predicted[near][1])))))
    if not positions:
        return True
    return bool((np.mean(positions) + np.mean(angles)) / 2.0 < LENGTH)
