"""Category of an object from its proportions and the names of its parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from articulate.reconstruct.actors.semantic.ontology import words_of
from articulate.reconstruct.scan.scan_mesh import ScanMesh

LEAST_PROBABILITY = 0.6
"""Probability below which the category is unknown."""
MISSING = 1.5
"""Negative logarithm of the probability that a usual part is not among the named ones."""
FILL_SPREAD = 0.12
"""Standard deviation of the share of the box that is in the convex hull."""


@dataclass(frozen=True)
class Shape:
    """Proportions and parts of a category."""

    parts: str
    """Words for its usual parts; alternatives are separated by ``/``."""
    others: str
    """Words for other parts that it may have."""
    width: float
    """Width over height."""
    depth: float
    """Depth over height."""
    spread: float
    """Standard deviation of the logarithms of both."""
    fill: float = 0.95
    """Share of the box that is in the convex hull."""
    most: int = 1
    """Largest number of parts of the first word."""


SHAPES: Mapping[str, Sequence[Shape]] = {
    "Bottle": [Shape("cap/lid/stopper", "pump", 0.32, 0.32, 0.25, 0.65)],
    "Box": [Shape("lid/flap/cover", "", 1.6, 1.1, 0.3, most=4)],
    "Bucket": [Shape("bail/handle", "lid", 1.2, 1.1, 0.2, 0.55)],
    "Chair": [Shape("seat", "back backrest wheel lever", 0.6, 0.6, 0.25, 0.55)],
    "Dishwasher": [Shape("door", "rack button", 0.66, 0.74, 0.12)],
    "Door": [Shape("leaf/door", "lever handle knob", 0.46, 0.07, 0.3, 0.8, most=2)],
    "Faucet": [Shape("spout/lever/handle/tap", "hot cold switch knob", 0.6, 0.7, 0.6, 0.35, 3)],
    "Kettle": [Shape("lid", "handle", 0.75, 0.95, 0.2, 0.5)],
    "KitchenPot": [Shape("lid", "", 1.6, 1.2, 0.25, 0.55)],
    "Laptop": [
        Shape("lid/screen", "", 1.4, 1.0, 0.3, 0.6),
        Shape("lid/screen", "", 11.0, 8.0, 0.5),
    ],
    "Microwave": [Shape("door", "knob button", 1.7, 1.4, 0.2)],
    "Oven": [Shape("door knob/button", "drawer", 0.73, 0.73, 0.15, most=2)],
    "Refrigerator": [Shape("door", "drawer freezer fridge", 0.4, 0.4, 0.25, most=4)],
    "Safe": [Shape("door dial/wheel/knob/button", "lever handle", 0.9, 0.9, 0.25)],
    "StorageFurniture": [Shape("drawer/door", "", 0.95, 0.55, 0.45, most=20)],
    "Suitcase": [Shape("front/lid pull/handle", "wheel", 0.65, 0.38, 0.25, 0.85)],
    "Switch": [Shape("lever/dial/button/toggle/switch", "", 0.8, 0.3, 0.35, 0.65, 9)],
    "Table": [Shape("drawer", "door", 1.7, 0.85, 0.35, most=12)],
    "Toilet": [Shape("seat/lid cover/lid", "lever button", 0.58, 0.95, 0.2, 0.6, 2)],
    "TrashCan": [Shape("lid pedal", "door wheel flap", 0.7, 0.85, 0.3, 0.7, 2)],
    "WashingMachine": [Shape("dial/knob/button door", "drawer", 0.72, 0.72, 0.1)],
    "Window": [Shape("sash/pane/window", "", 1.05, 0.12, 0.4, 0.86, 4)],
}
"""Shapes of PartNet-Mobility's categories, closed or as usually placed; of generated objects."""


def category_by_parts(mesh: ScanMesh, names: Sequence[str]) -> str:
    """Return PartNet-Mobility's category of an object, or ``unknown``.

    Args:
        mesh: The object; its front is +x.
        names: Names of its moving parts.
    """
    words = [frozenset(words_of(name)) for name in names]
    corners = mesh.vertices[np.unique(mesh.faces)]
    fill = float(ConvexHull(corners).volume / np.prod(mesh.size))
    depth, width = (float(np.log(side / mesh.size[2])) for side in mesh.size[:2])
    scores = {
        category: max(_score(words, width, depth, fill, shape) for shape in shapes)
        for category, shapes in SHAPES.items()
    }
    best = max(scores, key=lambda name: scores[name])
    total = sum(float(np.exp(score - scores[best])) for score in scores.values())
    known = np.isfinite(scores[best]) and 1.0 / total >= LEAST_PROBABILITY
    return best if known else "unknown"


def _score(
    words: Sequence[frozenset[str]], width: float, depth: float, fill: float, shape: Shape
) -> float:
    """Return the logarithm of the likelihood of parts and logarithms of the proportions."""
    usual = [frozenset(group.split("/")) for group in shape.parts.split()]
    known = frozenset(shape.others.split()).union(*usual)
    if any(not names & known for names in words):
        return -np.inf
    if sum(bool(names & usual[0]) for names in words) > shape.most:
        return -np.inf
    missing = sum(not any(names & group for names in words) for group in usual)
    off = (width - np.log(shape.width)) ** 2 + (depth - np.log(shape.depth)) ** 2
    off = off / shape.spread**2 + ((fill - shape.fill) / FILL_SPREAD) ** 2
    return float(-0.5 * off - 2.0 * np.log(shape.spread) - MISSING * missing)
