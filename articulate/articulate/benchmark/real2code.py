"""Outputs of Real2Code (Mandi et al., 2024): oriented boxes of the parts, and code for the joints.

A file ``ID.txt`` holds the text that the model reads, then the text that it writes::

    bboxes={
    0:{'center':[0.0,0.0,0.5],'R':[[1.0,0.0,0.0],[0.0,1.0,0.0],[0.0,0.0,1.0]],'extent':[1.0,0.8,1.0]},
    }
    root_geom = 0
    child_joints = [
    dict(box=1,type='hinge',idx=2,edge=[1,-1],sign=1),
    ]

Columns of ``R`` are the axes of a box and ``extent`` its full size. The axis of a joint is
``sign * R[:, idx]``; a hinge passes through ``center + R (e * extent / 2)``, where e is ``edge``
with 0 inserted at ``idx``. The format has no limits: the released code sets 0 to 1.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from articulate.benchmark.imported_part import (
    MAX_BYTES,
    MAX_PARTS,
    ImportedPart,
    InvalidOutputError,
    box_corners,
)
from articulate.errors import UsageError
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.transforms import Array, normalised
from articulate.untrusted import read_text

NUMBER = r"-?\d{1,12}(?:\.\d{0,12})?(?:[eE][-+]?\d{1,2})?"
BOX = re.compile(
    r"\s*['\"]?(\d{1,3})['\"]?\s*:\s*\{\s*['\"]center['\"]\s*:\s*(\[[^\]]{0,200}\])\s*,"
    r"\s*['\"]R['\"]\s*:\s*(\[\[.{0,400}?\]\])\s*,\s*['\"]extent['\"]\s*:\s*(\[[^\]]{0,200}\])\s*\}"
)
JOINT = re.compile(r"\s*dict\(([^()]{0,400})\)\s*,?\s*")
LIST = re.compile(r"child_joints\s*=\s*\[")
ROOT = re.compile(r"root_geom\s*=\s*['\"]?(\d{1,3})")
LIMITS = (0.0, 1.0)
"""Range of every joint in the released code."""
EDGES = ((1, 1), (1, -1), (-1, 1), (-1, -1))


def read_real2code(path: Path) -> list[ImportedPart]:
    """Read boxes and joints; the first part is the body.

    Raises:
        InvalidOutputError: The text is not in the format, or a box has two joints.
        UsageError: The file cannot be read.
    """
    text = read_text(path, MAX_BYTES)
    boxes = _boxes(path, text)
    joints = _joints(path, text)
    named = ROOT.search(text)
    free = [k for k in boxes if k not in joints]
    root = int(named.group(1)) if named else (free[0] if free else -1)
    if root not in boxes:
        raise InvalidOutputError("syntax", path, f"box {root} of the body does not exist")
    if root in joints:
        raise InvalidOutputError("cycle", path, f"the body, box {root}, is a child")
    unknown = [k for k in joints if k not in boxes]
    if unknown:
        raise InvalidOutputError("syntax", path, f"box {unknown[0]} of a joint does not exist")
    ordered = [root, *(k for k in boxes if k != root)]
    return [_part(str(k), boxes[k], joints.get(k)) for k in ordered]


Obb = tuple[Array, Array, Array]
"""Centre (3,), axes as columns (3, 3) and extent (3,)."""


def _boxes(path: Path, text: str) -> dict[int, Obb]:
    boxes: dict[int, Obb] = {}
    for found in BOX.finditer(text):
        k, (centre, R, extent) = int(found.group(1)), map(_numbers, found.group(2, 3, 4))
        if k in boxes:
            raise InvalidOutputError("repeated_link", path, f"box {k}")
        if len(centre) != 3 or len(R) != 9 or len(extent) != 3:
            raise InvalidOutputError("syntax", path, f"box {k}: 3, 9 and 3 numbers are expected")
        u, _, v = np.linalg.svd(R.reshape(3, 3))  # axes are rounded, and may be left-handed
        boxes[k] = (centre, u @ v, np.abs(extent))
    if not 2 <= len(boxes) <= MAX_PARTS:
        raise InvalidOutputError("syntax", path, f"{len(boxes)} boxes; 2 to {MAX_PARTS}")
    return boxes


def _joints(path: Path, text: str) -> dict[int, Mapping[str, str]]:
    start = LIST.search(text)
    if start is None:
        raise InvalidOutputError("syntax", path, "no child_joints")
    joints: dict[int, Mapping[str, str]] = {}
    at = start.end()
    while found := JOINT.match(text, at):
        at = found.end()
        pairs = re.findall(r"(\w+)\s*=\s*(\[[^\]]*\]|[^,\]]+)", found.group(1))
        fields = {key: value.strip(" '\"") for key, value in pairs}
        try:
            k = int(fields["box"])
            _check(fields)
        except (KeyError, ValueError) as error:
            raise InvalidOutputError("syntax", path, f"a joint: {error}"[:150]) from None
        if k in joints:
            raise InvalidOutputError("repeated_link", path, f"box {k} has two joints")
        joints[k] = fields
    if not re.match(r"\s*\]", text[at : at + 100]):
        raise InvalidOutputError("syntax", path, "child_joints does not end")
    return joints


def _check(fields: Mapping[str, str]) -> None:
    if fields["type"] not in {"hinge", "slide"}:
        raise ValueError("type is neither hinge nor slide")
    if fields["idx"] not in {"0", "1", "2"}:
        raise ValueError("idx is not 0, 1 or 2")
    if int(fields["sign"]) not in {-1, 1}:
        raise ValueError("sign is not 1 or -1")
    edge = _numbers(fields["edge"])
    if len(edge) != 2 or not np.isin(edge, (-1.0, 1.0)).all():
        raise ValueError("edge is not a pair of 1 and -1")


def _part(name: str, box: Obb, fields: Mapping[str, str] | None) -> ImportedPart:
    centre, R, extent = box
    corners = centre + box_corners(-0.5 * extent, 0.5 * extent) @ R.T
    if fields is None:
        return ImportedPart(name=name, corners=corners)
    idx = int(fields["idx"])
    arm = np.insert(_numbers(fields["edge"]), idx, 0.0)
    return ImportedPart(
        name=name,
        corners=corners,
        kind="prismatic" if fields["type"] == "slide" else "revolute",
        axis=int(fields["sign"]) * R[:, idx],
        pivot=centre + R @ (arm * extent / 2.0),
        lower=LIMITS[0],
        upper=LIMITS[1],
    )


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in re.findall(NUMBER, text)])


def write_real2code(boxes: Sequence[Array], joints: Sequence[PredictedJoint | None]) -> str:
    """Return true parts and joints in the format, by the rule of Real2Code's labels.

    Args:
        boxes: Lowest and highest corner (2, 3) of each part; the first is the body.
        joints: Joint of each part; None for fixed parts.
    """
    lines = ["bboxes={"]
    identity = str(np.eye(3).tolist()).replace(" ", "")
    for k, (low, high) in enumerate(boxes):
        centre, extent = (_rounded(v) for v in (0.5 * (low + high), high - low))
        lines.append(f"{k}:{{'center':{centre},'R':{identity},'extent':{extent}}},")
    lines += ["}", "root_geom = 0", "child_joints = ["]
    for k, joint in enumerate(joints):
        if joint is None or k == 0:
            continue
        axis = normalised(joint.axis_o)
        idx = int(np.argmax(np.abs(axis)))
        sign = 1 if axis[idx] > 0.0 else -1
        kind, edge = ("slide", (1, 1)) if joint.kind == "prismatic" else ("hinge", None)
        edge = edge or _edge(boxes[k], np.asarray(joint.pivot_o), idx)
        pair = f"[{edge[0]},{edge[1]}]"
        lines.append(f"dict(box={k},type='{kind}',idx={idx},edge={pair},sign={sign}),")
    return "\n".join([*lines, "]", ""])


def _edge(box: Array, pivot: Array, idx: int) -> tuple[int, int]:
    """Return the edge along axis ``idx`` whose middle is nearest to the joint position (3,)."""
    low, high = box

    def distance(edge: tuple[int, int]) -> float:
        middle = 0.5 * (low + high) + np.insert(edge, idx, 0.0) * (high - low) / 2.0
        return float(np.linalg.norm(middle - pivot))

    return min(EDGES, key=distance)


def _rounded(values: Array) -> str:
    return str([round(float(v), 2) for v in values]).replace(" ", "")


def list_files(folder: Path, suffixes: Sequence[str]) -> dict[str, Path]:
    """Return the files of a folder by name without suffix.

    Raises:
        UsageError: There is none.
    """
    found = {p.stem: p for p in sorted(folder.glob("*")) if p.suffix in suffixes}
    if not found:
        raise UsageError(f"{folder}: holds no file {' or '.join('*' + s for s in suffixes)}")
    return found
