"""Find drawers, doors and flaps on the front of an object, by a network.

Every point of the front predicts the kind of the part at this point and the edges of that part
(after Tian et al., FCOS, ICCV 2019). Points that predict nearly the same rectangle are one part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from articulate.reconstruct.fitting.decoder import read_network
from articulate.reconstruct.recognition.classifier import SIDE_PX, feature_maps
from articulate.render.raster import Pixels
from articulate.transforms import Array, Ints

KINDS = ("fixed", "drawer", "door_left", "door_right", "flap")
"""Kinds of a point; doors by the side of their hinge."""
GRID = 28
"""Points along each side of the front with its margin."""
MARGIN = 0.1
"""Margin around the front in its square image, as a share of the front."""
WEIGHTS_FILE = Path(__file__).with_name("front_weights.npz")
"""Weights, trained on renders of the procedural library by ``benchmarks/photo_networks.py``."""
SAME = 0.5
"""Intersection over union of rectangles from which they are one part."""
MIN_SUPPORT = 0.35
"""Least share of the points of a part that predict it."""
MOST_SHARED = 0.35
"""Most that a part shares with a better supported one, as a share of the smaller one."""
MIN_SIDE = 0.04
"""Smallest side of a part, as a share of the front."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontPart:
    """Openable part, in shares of the width of the front from the left and of its height."""

    left: float
    right: float
    bottom: float
    """From below."""
    top: float
    """From below."""
    kinds: Array
    """Probability of each of ``KINDS`` (5,)."""
    support: float
    """Share of the points on the part that predict it."""

    @property
    def kind(self) -> str:
        """Most probable kind of an openable part."""
        return KINDS[1 + int(np.argmax(self.kinds[1:]))]


def front_square(image: Pixels, corners: Array) -> tuple[Pixels, Array]:
    """Return the front with its margin (224, 224, 3), and the homography (3, 3) to it [px].

    Args:
        image: Colours (H, W, 3).
        corners: Corners of the front in the image (4, 2) [px], from top left clockwise.
    """
    share = MARGIN / (1.0 + 2.0 * MARGIN)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (1.0 - 2.0 * share) + share
    target = (square * SIDE_PX - 0.5).astype(np.float32)
    longest = max(float(np.linalg.norm(corners[k] - corners[k - 1])) for k in range(4))
    scale = SIDE_PX * (1.0 - 2.0 * share) / max(longest, 1.0)
    if scale < 0.7:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), 0.35 / scale), dtype=np.uint8)
    H = cv2.getPerspectiveTransform(corners.astype(np.float32), target)
    out = cv2.warpPerspective(image, H, (SIDE_PX, SIDE_PX), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(out, dtype=np.uint8), np.asarray(H)


def points() -> Array:
    """Return the positions of the points (784, 2) in the square image, in shares of its side."""
    at = (np.arange(GRID) + 0.5) / GRID
    return np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)


def find_parts(front: Pixels, aspect: float) -> tuple[FrontPart, ...]:
    """Return the openable parts of a front, from the top left by rows; they do not overlap.

    Args:
        front: Front with its margin (224, 224, 3), as from ``front_square``.
        aspect: Width over height of the front.

    Raises:
        UsageError: The package with the weights of the ImageNet network is not installed.
    """
    network = read_network(WEIGHTS_FILE)
    maps = feature_maps([front])
    coarse, _ = network.decode(maps)
    fine = network.layer("in_8", maps["stride_8"][0])
    plane = np.full((1, GRID, GRID), np.log(aspect), dtype=np.float32)
    x = np.concatenate([coarse.repeat(2, axis=1).repeat(2, axis=2), fine, plane])
    x = network.layer("last", network.layer("join", x))
    out = network.layer("out", x, relu=False).astype(np.float64).reshape(len(KINDS) + 4, -1)
    kinds = np.exp(out[: len(KINDS)] - out[: len(KINDS)].max(axis=0))
    reach = 1.0 / (1.0 + np.exp(-out[len(KINDS) :]))
    return grouped((kinds / kinds.sum(axis=0)).T, reach.T)


def grouped(kinds: Array, reach: Array) -> tuple[FrontPart, ...]:
    """Return the parts that points predict.

    Args:
        kinds: Probabilities of ``KINDS`` at each of ``points`` (784, 5).
        reach: Distance of each point to the left, right, upper and lower edge of its part (784, 4),
            in shares of the square image.
    """
    at = points()
    boxes = at[:, [0, 0, 1, 1]] + reach * [-1.0, 1.0, -1.0, 1.0]
    open_points = np.flatnonzero(kinds[:, 0] < 0.5)
    score = 1.0 - kinds[open_points, 0]
    left = open_points[np.argsort(-score, kind="stable")]
    found: list[FrontPart] = []
    while len(left):
        alike = overlaps(boxes[left], _central(boxes, left)) > SAME
        alike[0] = True
        found.append(_part(boxes[left[alike]], kinds[left[alike]]))
        left = left[~alike]
    kept: list[FrontPart] = []
    for part in sorted(found, key=lambda part: -part.support):
        if part.support > MIN_SUPPORT and all(_shared(part, one) < MOST_SHARED for one in kept):
            kept.append(part)
    return _separated(kept)


def _central(boxes: Array, left: Ints) -> Array:
    """Return the rectangle (4,) that agrees best with those of the most certain points."""
    first = boxes[left[: min(len(left), 40)]]
    agreement = [float((overlaps(boxes[left], box) > SAME).sum()) for box in first]
    return np.asarray(first[int(np.argmax(agreement))])


def overlaps(boxes: Array, box: Array) -> Array:
    """Return the intersection over union of rectangles (N, 4) with one (4,)."""
    wide = np.minimum(boxes[:, 1], box[1]) - np.maximum(boxes[:, 0], box[0])
    high = np.minimum(boxes[:, 3], box[3]) - np.maximum(boxes[:, 2], box[2])
    both = np.clip(wide, 0.0, None) * np.clip(high, 0.0, None)
    area = (boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])
    own = (box[1] - box[0]) * (box[3] - box[2])
    return np.asarray(both / np.maximum(area + own - both, 1e-9))


def _shared(one: FrontPart, other: FrontPart) -> float:
    """Return what two parts share, as a share of the smaller one."""
    wide = min(one.right, other.right) - max(one.left, other.left)
    high = min(one.top, other.top) - max(one.bottom, other.bottom)
    areas = [(p.right - p.left) * (p.top - p.bottom) for p in (one, other)]
    return max(wide, 0.0) * max(high, 0.0) / max(min(areas), 1e-9)


def _part(boxes: Array, kinds: Array) -> FrontPart:
    """Return the part that points with rectangles (N, 4) and kinds (N, 5) predict."""
    left, right, top, bottom = np.median(boxes, axis=0)
    area = GRID**2 * max((right - left) * (bottom - top), 1e-9)
    scale = 1.0 + 2.0 * MARGIN
    return FrontPart(
        left=float(scale * left - MARGIN),
        right=float(scale * right - MARGIN),
        bottom=float(1.0 + MARGIN - scale * bottom),
        top=float(1.0 + MARGIN - scale * top),
        kinds=kinds.mean(axis=0),
        support=float(min(1.0, len(boxes) / area)),
    )


def _separated(parts: list[FrontPart]) -> tuple[FrontPart, ...]:
    """Clip parts to the front and divide what two of them share; drop those that vanish."""
    out = [
        replace(p, left=max(p.left, 0.0), right=min(p.right, 1.0), bottom=max(p.bottom, 0.0))
        for p in parts
    ]
    out = [replace(p, top=min(p.top, 1.0)) for p in out]
    for i in range(len(out)):
        for j in range(i):
            a, b = out[i], out[j]
            wide = min(a.right, b.right) - max(a.left, b.left)
            high = min(a.top, b.top) - max(a.bottom, b.bottom)
            if wide <= 0.0 or high <= 0.0:
                continue
            if wide < high:
                cut = 0.5 * (min(a.right, b.right) + max(a.left, b.left))
                first = a.left + a.right < b.left + b.right
                out[i] = replace(a, right=cut) if first else replace(a, left=cut)
                out[j] = replace(b, left=cut) if first else replace(b, right=cut)
            else:
                cut = 0.5 * (min(a.top, b.top) + max(a.bottom, b.bottom))
                first = a.bottom + a.top < b.bottom + b.top
                out[i] = replace(a, top=cut) if first else replace(a, bottom=cut)
                out[j] = replace(b, bottom=cut) if first else replace(b, top=cut)
    kept = [p for p in out if min(p.right - p.left, p.top - p.bottom) > MIN_SIDE]
    return tuple(sorted(kept, key=lambda p: (-round(p.top, 2), p.left)))
