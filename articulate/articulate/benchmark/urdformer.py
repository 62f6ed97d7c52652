"""Outputs of URDFormer (Chen et al., RSS 2024): URDF files, or the raw outputs of its network.

A raw output is a JSON object with the arrays of the released code, each in a list of one element::

    part_bases             [class of the body]
    part_meshes            [[class, ...]]
    part_positions_start   [[[y, z], ...]]   bins of 0 to 12 on the body
    part_positions_end     [[[y, z], ...]]
    part_relations         [[[[score, ... 6], ... n + 1], ... n + 1]]   row i + 1: parent of part i
    part_normalized_bbox   [[row, column, height, width], ...]   shares of the image; may be absent

Frame: front at +x, y to the viewer's right, z up; the body fills 0 to 1 in y and z.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from articulate.benchmark.imported_part import (
    MAX_BYTES,
    MAX_PARTS,
    ImportedPart,
    InvalidOutputError,
    box_corners,
)
from articulate.errors import AssetError, UsageError
from articulate.formats.config import ConvertConfig
from articulate.formats.link_tree import unit_axis
from articulate.formats.load_meshes import Loader
from articulate.formats.read_urdf import read_urdf
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceObject
from articulate.formats.xml_input import child_of, children_of, read_markup
from articulate.reconstruct.actors.protocol import JointKind
from articulate.reconstruct.link_meshes import link_pieces, link_poses, merge_pieces
from articulate.transforms import Array
from articulate.untrusted import load_json_object

BINS = 12
PARTS = (
    "none",
    "drawer",
    "doorL",
    "doorR",
    "handle",
    "knob",
    "washer_door",
    "doorD",
    "oven_door",
    "doorU",
)
"""Classes of parts."""
JOINTS: Mapping[str, tuple[JointKind, tuple[float, float, float], float, float]] = {
    "drawer": ("prismatic", (1.0, 0.0, 0.0), 0.0, 0.4),
    "doorL": ("revolute", (0.0, 0.0, 1.0), -1.57, 0.0),
    "doorR": ("revolute", (0.0, 0.0, 1.0), 0.0, 1.57),
    "doorD": ("revolute", (0.0, 1.0, 0.0), -1.57, 0.0),
    "oven_door": ("revolute", (0.0, 1.0, 0.0), 0.0, 1.57),
    "doorU": ("revolute", (0.0, 1.0, 0.0), 0.0, 1.57),
    "washer_door": ("revolute", (0.0, 0.0, 1.0), 0.0, 1.57),
}
"""Type, axis and limits of the joint of each class; other classes are fixed."""
FRIDGE, FRIDGE_HEIGHT = 5, 2.0
"""Class of a refrigerator's body, and its height; other bodies have 1."""
BODY_DEPTH, PANEL_DEPTH = 1.0, 0.01
"""Extent along x of the body and of a panel."""


def read_urdformer(path: Path) -> list[ImportedPart]:
    """Read a URDF or a raw output as JSON; the first part is the body.

    Raises:
        InvalidOutputError: The links form no tree, or the file is not in the format.
        UsageError: A file cannot be read.
    """
    return _from_raw(path) if path.suffix == ".json" else _from_urdf(path)


def check_urdf(path: Path) -> SourceObject:
    """Read a URDF whose links form a tree.

    Raises:
        InvalidOutputError: A link is repeated, the links form no tree, or it is no URDF.
    """
    try:
        root = read_markup(path, Repairs())
        links = [(e.get("name") or "").strip() for e in children_of(root, "link")]
        joints = children_of(root, "joint")
        ends = [(_link(e, "parent"), _link(e, "child")) for e in joints]
        _check_tree(path, links, ends)
        return read_urdf(path)
    except InvalidOutputError:
        raise
    except AssetError as error:
        raise InvalidOutputError("syntax", path, str(error)) from None


def _link(joint: Any, tag: str) -> str:
    element = child_of(joint, tag)
    return "" if element is None else (element.get("link") or "").strip()


def _check_tree(path: Path, links: Sequence[str], ends: Sequence[tuple[str, str]]) -> None:
    """Reject repeated links and links with two parents or in a cycle."""
    if len(links) > MAX_PARTS:
        raise InvalidOutputError("syntax", path, f"{len(links)} links; at most {MAX_PARTS}")
    repeated = sorted({name for name in links if links.count(name) > 1})
    if repeated:
        raise InvalidOutputError("repeated_link", path, repeated[0][:60])
    parents: dict[str, str] = {}
    for parent, child in ends:
        if child in parents:
            raise InvalidOutputError("cycle", path, f"{child[:60]} has two parents")
        parents[child] = parent
    for name in parents:
        seen = {name}
        while name in parents:
            name = parents[name]
            if name in seen:
                raise InvalidOutputError("cycle", path, f"{name[:60]} is its own ancestor")
            seen.add(name)


def _from_urdf(path: Path) -> list[ImportedPart]:
    source = check_urdf(path)
    poses = link_poses(source)
    loader = Loader(source, ConvertConfig())
    joints = {joint.child: joint for joint in source.joints}
    parts = []
    for name in source.links:
        pieces = link_pieces(loader, source, name, poses[name])
        if not pieces:
            continue
        low, high = merge_pieces(name, pieces).bounds
        corners, joint = box_corners(low, high), joints.get(name)
        if joint is None or joint.kind not in {"prismatic", "revolute", "continuous"}:
            parts.append(ImportedPart(name=name, corners=corners))
            continue
        kind: JointKind = "prismatic" if joint.kind == "prismatic" else "revolute"
        limited = None not in (joint.lower, joint.upper) and joint.kind != "continuous"
        parts.append(
            ImportedPart(
                name=name,
                corners=corners,
                kind=kind if limited or kind == "prismatic" else "continuous",
                axis=poses[name][:3, :3] @ unit_axis(joint),
                pivot=poses[name][:3, 3],
                lower=joint.lower if limited else None,
                upper=joint.upper if limited else None,
            )
        )
    if not parts:
        raise UsageError(f"{path.name}: has no visible geometry")
    return parts


def _from_raw(path: Path) -> list[ImportedPart]:
    try:
        content = load_json_object(path, limit_bytes=MAX_BYTES, error=AssetError)
        body = int(content["part_bases"][0])
        classes = [PARTS[_class(k)] for k in content["part_meshes"][0]]
        n = len(classes)
        if n > MAX_PARTS:
            raise ValueError(f"{n} parts; at most {MAX_PARTS}")
        start = np.asarray(content["part_positions_start"][0], np.float64).reshape(n, 2) / BINS
        end = np.asarray(content["part_positions_end"][0], np.float64).reshape(n, 2) / BINS
        scores = np.asarray(content["part_relations"][0], np.float64).reshape(n + 1, n + 1, -1)
        if not scores.shape[2]:
            raise ValueError("part_relations hold no scores")
        boxes = content.get("part_normalized_bbox")
        boxes_px = [None] * n if boxes is None else [_box(b) for b in boxes]
        if len(boxes_px) != n:
            raise ValueError(f"{len(boxes_px)} boxes for {n} parts")
    except (KeyError, IndexError, TypeError, ValueError, AssetError) as error:
        raise InvalidOutputError("syntax", path, f"{type(error).__name__}: {error}"[:150]) from None
    parent = [int(scores[i + 1].argmax()) // scores.shape[2] for i in range(n)]
    names = ["base_link", *(f"{kind}{i}" for i, kind in enumerate(classes))]
    _check_tree(path, names, [(names[parent[i]], names[i + 1]) for i in range(n)])
    size = np.array([1.0, FRIDGE_HEIGHT if body == FRIDGE else 1.0])
    low = np.array([-BODY_DEPTH, 0.0, 0.0])
    parts = [ImportedPart(name="base_link", corners=box_corners(low, np.array([0.0, *size])))]
    for i, kind in enumerate(classes):
        if kind == "none":
            continue
        parts.append(_raw_part(names[i + 1], kind, start[i] * size, end[i] * size, boxes_px[i]))
    return parts


def _raw_part(
    name: str,
    kind: str,
    start: Array,
    end: Array,
    box_px: tuple[float, float, float, float] | None,
) -> ImportedPart:
    """Return a part of the front from its opposite corners (2,) in y and z."""
    low = np.array([-PANEL_DEPTH, *np.minimum(start, end)])
    corners = box_corners(low, np.array([0.0, *np.maximum(start, end)]))
    if kind not in JOINTS:
        return ImportedPart(name=name, corners=corners, box_px=box_px)
    joint, axis, lower, upper = JOINTS[kind]
    return ImportedPart(
        name=name,
        corners=corners,
        kind=joint,
        axis=np.array(axis),
        pivot=np.array([0.0, *start]),
        lower=lower,
        upper=upper,
        box_px=box_px,
    )


def _class(value: Any) -> int:
    k = int(value)
    if not 0 <= k < len(PARTS):
        raise ValueError(f"class {k} of a part; 0 to {len(PARTS) - 1} are known")
    return k


def _box(values: Sequence[Any]) -> tuple[float, float, float, float]:
    row, column, height, width = (float(v) for v in values)
    return row, column, height, width
