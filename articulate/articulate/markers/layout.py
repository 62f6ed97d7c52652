"""Marker layout of an object: marker identifiers, sizes and positions on its links.

A layout is a YAML file::

    dictionary: 4x4_50
    markers:
      - {id: 0, link: body, size_m: 0.04, center_m: [0.2, 0, 0.7], normal: [1, 0, 0]}
      - {id: 1, link: drawer, size_m: 0.04, center_m: [0.2, 0.1, 0.5], normal: [1, 0, 0]}

Positions are in the object frame with every joint closed: z points up, z = 0 is the lowest point of
the object. ``size_m`` is the side of the black square. ``normal`` points out of the printed side
and ``up`` towards the upper edge of the print, by default [0, 0, 1].
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from articulate.assets.asset import Asset, Vec3, joint_motion
from articulate.config import from_mapping, read_yaml, to_yaml
from articulate.errors import ConfigError, nearest, quote
from articulate.files import write_text
from articulate.transforms import Array, apply, inverse, normalised, pose

DICTIONARIES = {
    "4x4_50": ("DICT_4X4_50", 50, 4),
    "5x5_100": ("DICT_5X5_100", 100, 5),
    "6x6_250": ("DICT_6X6_250", 250, 6),
    "apriltag_36h11": ("DICT_APRILTAG_36H11", 587, 6),
}
"""Dictionaries of markers: OpenCV's name, number of markers, modules of the pattern on a side."""
DEFAULT_DICTIONARY = "4x4_50"
"""Dictionary with the largest modules, which are detected at the greatest distance."""
MAX_COORDINATE_M = 10.0
"""Largest coordinate of a marker [m]."""
MAX_SIZE_M = 1.0
"""Largest side of a marker [m]."""
SQUARE = np.array([(-0.5, 0.5, 0.0), (0.5, 0.5, 0.0), (0.5, -0.5, 0.0), (-0.5, -0.5, 0.0)])
"""Corners (4, 3) of a marker of side 1 in its frame, in OpenCV's order: upper left, clockwise."""


@dataclass(frozen=True, kw_only=True)
class Marker:
    """One printed marker on a link of an object."""

    id: int
    """Identifier in the dictionary."""
    link: str
    """Link that it is attached to."""
    size_m: float
    """Side of the black square [m]."""
    center_m: Vec3
    """Center in the object frame, every joint closed [m]."""
    normal: Vec3
    """Direction out of the printed side, object frame."""
    up: Vec3 = (0.0, 0.0, 1.0)
    """Direction of the upper edge of the print, object frame."""

    def __post_init__(self) -> None:
        where = f"marker {self.id}"
        if not 0.001 <= self.size_m <= MAX_SIZE_M:
            raise ConfigError(
                f"{where}: size_m is {self.size_m:g}; it must be in [0.001, {MAX_SIZE_M:g}] m"
            )
        if not all(abs(number) <= MAX_COORDINATE_M for number in self.center_m):
            raise ConfigError(f"{where}: center_m is not within {MAX_COORDINATE_M:g} m of 0")
        normal, up = normalised(self.normal), normalised(self.up)
        if not np.linalg.norm(np.cross(normal, up)) > 0.1:  # also where one is 0 or not finite
            raise ConfigError(
                f"{where}: normal {list(self.normal)} and up {list(self.up)} must be two "
                "directions that are not parallel"
            )

    def T_om(self) -> Array:
        """Return the pose of the marker in the object frame, every joint closed (4, 4) [m].

        Its x axis is to the right of the print, y up, z out of it. ``up`` is made perpendicular to
        ``normal``.
        """
        z = normalised(self.normal)
        x = normalised(np.cross(self.up, z))
        return pose(self.center_m, np.stack([x, np.cross(z, x), z], axis=-1))

    def corners_o(self) -> Array:
        """Return the corners in the object frame, every joint closed (4, 3) [m]."""
        return apply(self.T_om(), self.size_m * SQUARE)


@dataclass(frozen=True, kw_only=True)
class MarkerLayout:
    """Markers of one object."""

    markers: tuple[Marker, ...]
    """Markers with different identifiers."""
    dictionary: str = DEFAULT_DICTIONARY
    """One of :data:`DICTIONARIES`."""

    def __post_init__(self) -> None:
        count = dictionary_size(self.dictionary)
        if not self.markers:
            raise ConfigError("layout: markers is empty; list at least one marker")
        ids = [marker.id for marker in self.markers]
        for number in ids:
            if not 0 <= number < count:
                raise ConfigError(
                    f"marker {number}: dictionary {self.dictionary} has markers 0 to {count - 1}"
                )
            if ids.count(number) > 1:
                raise ConfigError(f"marker {number}: listed twice; identifiers must differ")

    @property
    def ids(self) -> tuple[int, ...]:
        """Identifiers of the markers."""
        return tuple(marker.id for marker in self.markers)

    def marker(self, number: int) -> Marker:
        """Return the marker with identifier ``number``; KeyError if there is none."""
        for marker in self.markers:
            if marker.id == number:
                return marker
        raise KeyError(number)


def dictionary_size(name: str) -> int:
    """Return the number of markers of a dictionary; ConfigError if it is unknown."""
    if name not in DICTIONARIES:
        raise ConfigError(f"unknown dictionary {quote(name)}{nearest(name, DICTIONARIES)}")
    return DICTIONARIES[name][1]


def load_layout(path: Path) -> MarkerLayout:
    """Read a marker layout.

    Raises:
        ConfigError: It cannot be read, a key is missing or unknown, or a value is not accepted.
    """
    content = read_yaml(path)
    rows = content.get("markers")
    for row in rows if isinstance(rows, list) else []:
        if isinstance(row, dict) and "size_m" not in row:
            raise ConfigError(
                f"{path}: marker {quote(row.get('id'))}: size_m is missing; measure the side of "
                "the black square of the print [m]"
            )
    return from_mapping(MarkerLayout, content, str(path))


def save_layout(path: Path, layout: MarkerLayout) -> None:
    """Write ``layout`` as YAML."""
    write_text(path, to_yaml(layout))


def moved_links(asset: Asset, joint: str) -> frozenset[str]:
    """Return the names of the links that ``joint`` moves."""
    moved = {asset.joint(joint).link}
    for link in asset.links:  # parents come before children
        if link.parent in moved:
            moved.add(link.name)
    return frozenset(moved)


def fixed_links(asset: Asset) -> frozenset[str]:
    """Return the names of the links that no joint moves."""
    return frozenset(link.name for link in asset.links) - _movable(asset)


def _movable(asset: Asset) -> frozenset[str]:
    return frozenset().union(*(moved_links(asset, joint.name) for joint in asset.joints))


@dataclass(frozen=True, eq=False)
class MarkerModel:
    """Corners of the markers of an object with one joint that moves."""

    ids: tuple[int, ...]
    """Identifiers (M,)."""
    corners_o: Array
    """Corners in the object frame with the joint at 0 (M, 4, 3) [m]."""
    moving: tuple[bool, ...]
    """True for markers on a link that the joint moves (M,)."""
    sizes_m: Array
    """Sides of the markers (M,) [m]."""
    hinge: bool
    """True if the joint rotates."""
    axis_o: Array
    """Axis of the joint (3,)."""
    pivot_o: Array
    """Point on the axis (3,) [m]."""
    range: tuple[float, float]
    """Lowest and highest position of the joint [m or rad]."""
    closed: float
    """Position of the joint in the closed state [m or rad]."""


def marker_model(asset: Asset, joint: str, layout: MarkerLayout) -> MarkerModel:
    """Return the marker corners of ``asset`` for estimating ``joint``.

    Markers on parts that other joints move are left out.

    Raises:
        ConfigError: A marker is on an unknown link, or no marker is on the body or on the part.
    """
    moved, fixed = moved_links(asset, joint), fixed_links(asset)
    names = [link.name for link in asset.links]
    used: list[Marker] = []
    for marker in layout.markers:
        if marker.link not in names:
            raise ConfigError(
                f"marker {marker.id}: {asset.name} has no link {quote(marker.link)}"
                f"{nearest(marker.link, names)}"
            )
        if marker.link in moved | fixed:
            used.append(marker)
    _require(used, moved, f"the part that {joint} moves", sorted(moved))
    _require(used, fixed, f"the body of {asset.name}", sorted(fixed))
    part = asset.joint(joint)
    back = inverse(joint_motion(part, part.closed))
    moving = tuple(marker.link in moved for marker in used)
    corners = [
        apply(back, marker.corners_o()) if is_moving else marker.corners_o()
        for marker, is_moving in zip(used, moving, strict=True)
    ]
    low, high = sorted((part.closed, part.open))
    return MarkerModel(
        ids=tuple(marker.id for marker in used),
        corners_o=np.array(corners),
        moving=moving,
        sizes_m=np.array([marker.size_m for marker in used]),
        hinge=part.kind == "hinge",
        axis_o=np.asarray(part.axis_o, dtype=np.float64),
        pivot_o=np.asarray(part.pivot_o, dtype=np.float64),
        range=(low, high),
        closed=float(part.closed),
    )


def _require(markers: Iterable[Marker], links: Iterable[str], what: str, names: list[str]) -> None:
    """Raise ConfigError unless a marker is on one of ``links``."""
    if not any(marker.link in links for marker in markers):
        raise ConfigError(f"layout: no marker on {what}; add one on {' or '.join(names)}")
