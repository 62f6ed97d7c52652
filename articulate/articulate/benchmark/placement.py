"""Errors of predicted part placements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from articulate.benchmark.protocols import ANGLE_RAD, LENGTH, Protocol
from articulate.render.parts import PartMesh
from articulate.transforms import Array, matrix_to_quat, rotation_angle

SAME_SIZE = 0.01
"""Parts whose boxes differ by less than this share of their size are interchangeable."""


@dataclass(frozen=True, kw_only=True)
class PlacementErrors:
    """Errors of all parts, in the order of the true object."""

    position: Array
    """Distance of the box centres (P,) [units]; infinite for a part without a placement."""
    angle_rad: Array
    """Rotation error of each part (P,); pi for a part without a placement."""
    visible_px: Array
    """Pixels of each part in the image (P,); NaN without an image."""
    shift: Array
    """Offset (3,) that was subtracted from all positions; zero if anchored [units]."""
    predicted: Array
    """Predicted position of each part (P, 3), before interchangeable parts are matched."""
    quat: Array
    """Predicted rotation of each part (P, 4), wxyz."""
    match: NDArray[np.intp]
    """Index of the predicted part that is matched with each true one (P,)."""

    @property
    def right(self) -> Array:
        """Mask (P,) of the parts within both thresholds of ``strict``."""
        return np.asarray((self.position <= LENGTH) & (self.angle_rad <= ANGLE_RAD))


def placement_errors(
    parts: Sequence[PartMesh],
    labels: Mapping[str, str],
    placements: Mapping[str, Array],
    *,
    anchored: bool,
    visible_px: Array | None = None,
) -> PlacementErrors:
    """Compute the errors of a placement.

    Parts of the same size and label are interchangeable: they are matched one to one so that the
    sum of distances is smallest.

    Args:
        parts: The true parts, placed in ``o``.
        labels: Label of each part in the evidence.
        placements: ``T_op`` (4, 4) of each part by name, from the part with the centre of its box
            at the origin.
        anchored: Positions in ``o`` can be known, as with a camera; else the largest part is taken
            as correct, and positions are compared relative to it.
        visible_px: Number of pixels of each part in the image (P,) [px].
    """
    n = len(parts)
    centres = np.stack([part.centre for part in parts])
    predicted, angles = np.full((n, 3), np.inf), np.full(n, np.pi)
    quats = np.full((n, 4), np.nan)
    for i, part in enumerate(parts):
        T = placements.get(part.name)
        if T is not None and np.shape(T) == (4, 4) and np.isfinite(T).all():
            predicted[i] = np.asarray(T)[:3, 3]
            angles[i] = rotation_angle(np.asarray(T, dtype=np.float64)[:3, :3])
            quats[i] = matrix_to_quat(np.asarray(T, dtype=np.float64)[:3, :3])
    largest = int(np.argmax([float(np.prod(np.ptp(p.bounds, axis=0))) for p in parts]))
    shift = np.zeros(3)
    if not anchored and np.isfinite(predicted[largest]).all():
        shift = predicted[largest] - centres[largest]
        predicted = predicted - shift
    match = _match_parts(parts, labels, centres, predicted)
    return PlacementErrors(
        position=np.linalg.norm(predicted[match] - centres, axis=1),
        angle_rad=angles[match],
        visible_px=np.full(n, np.nan) if visible_px is None else visible_px,
        shift=shift,
        predicted=predicted,
        quat=quats,
        match=match,
    )


def _match_parts(
    parts: Sequence[PartMesh], labels: Mapping[str, str], centres: Array, predicted: Array
) -> NDArray[np.intp]:
    """Return the index of the predicted part for each true one (P,)."""
    far, tie_break = 1e6, 1e-6
    size = np.stack([np.ptp(part.bounds, axis=0) for part in parts])
    same_size = (
        np.abs(size[:, None] - size[None]).max(axis=-1) <= SAME_SIZE * size.max(axis=-1)[:, None]
    )
    named = np.array([labels.get(part.name, "") for part in parts])
    same = same_size & (named[:, None] == named[None])
    np.fill_diagonal(same, True)
    distance = np.linalg.norm(predicted[None] - centres[:, None], axis=-1)
    cost = np.where(same, np.minimum(np.nan_to_num(distance, posinf=far), far), 1e3 * far)
    cost += tie_break * (1.0 - np.eye(len(parts)))  # prefers each part itself among equals
    return np.asarray(linear_sum_assignment(cost)[1])


def placement_success(errors: PlacementErrors) -> dict[Protocol, bool]:
    """Return the success of an object's placement by protocol.

    The publication compares the mean of distance and angle over all parts with 0.05. Its code does
    so for parts with the same name, each with the nearest of that name, see
    :func:`released_placement`; ``strict`` requires every part to be correct.
    """
    mean = float(np.mean(0.5 * (errors.position + errors.angle_rad)))
    return {"paper": mean < LENGTH, "strict": bool(errors.right.all())}


def released_placement(
    truth: Mapping[str, tuple[Array, Array]], predicted: Mapping[str, tuple[Array, Array]]
) -> bool:
    """Return the success of a placement in the released code.

    Only common names count; without any the error is 0. Each part is compared with the nearest
    predicted part whose name begins with the same word, which several parts may share.

    Args:
        truth: Box centre (3,) and quaternion wxyz (4,) of each part, by its semantic name.
        predicted: The same for the predicted parts.
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
