"""Predictions of other methods as an actor: imported parts are aligned and matched to true links.

The publication matches each predicted box of URDFormer to the link whose segmentation mask overlaps
it. Outputs without boxes in the image are compared by the boxes of their parts after alignment.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from articulate.benchmark.imported_part import REASONS, ImportedPart, InvalidOutputError
from articulate.benchmark.real2code import list_files, read_real2code
from articulate.benchmark.records import Record
from articulate.benchmark.urdformer import check_urdf, read_urdformer
from articulate.errors import ConfigError, UsageError, nearest
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction
from articulate.render.parts import joint_bounds
from articulate.render.scene import PartScene
from articulate.transforms import Array, normalised

SUFFIXES = {"urdformer": (".urdf", ".json"), "real2code": (".txt",)}
"""Formats, and the suffixes of their files."""
READERS: dict[str, Callable[[Path], list[ImportedPart]]] = {
    "urdformer": read_urdformer,
    "real2code": read_real2code,
}
LEAST_OVERLAP = 0.1
"""A predicted part with less overlap has no link, as intersection over union."""
BETTER = 0.02
"""A rotation must improve the mean overlap by this to be preferred to the given frame."""
UNMATCHED = "no link"
"""Part of joints without a link; each counts as a joint of a fixed part."""


def is_imported(actor: str) -> bool:
    """Return whether an actor's name is ``FORMAT:FOLDER``."""
    return actor.partition(":")[0] in SUFFIXES


def split_source(source: str) -> tuple[str, Path]:
    """Return format and folder of ``FORMAT:FOLDER``.

    Raises:
        ConfigError: The format is unknown, or the folder does not exist.
    """
    form, _, folder = source.partition(":")
    if form not in SUFFIXES or not folder:
        known = ", ".join(f"{name}:FOLDER" for name in SUFFIXES)
        raise ConfigError(f"--predictions {source}: {known} are accepted{nearest(form, SUFFIXES)}")
    if not Path(folder).is_dir():
        raise ConfigError(f"--predictions {source}: {folder} is not a folder")
    return form, Path(folder)


def source_files(source: str) -> list[Path]:
    """Return the files of ``FORMAT:FOLDER``."""
    form, folder = split_source(source)
    return list(list_files(folder, SUFFIXES[form]).values())


def file_name(object_id: str) -> str:
    """Return the name without suffix of an object's file; slashes of the id become ``_``."""
    return object_id.replace("/", "_")


def validity(source: str, ids: Iterable[str]) -> Record:
    """Count files, invalid outputs by reason, files without object and objects without file.

    Args:
        source: ``FORMAT:FOLDER``.
        ids: Objects that are scored.
    """
    form, folder = split_source(source)
    files = list_files(folder, SUFFIXES[form])
    wanted = {file_name(i) for i in ids}
    invalid: Counter[str] = Counter()
    rows = []
    for name, path in files.items():
        error = _error(form, path)
        reason = error.reason if isinstance(error, InvalidOutputError) else ""
        invalid[reason] += bool(reason)
        rows.append({"file": path.name, "scored": name in wanted, "invalid": reason})
    return {
        "source": source,
        "files": len(files),
        "valid": sum(not row["invalid"] for row in rows),
        "invalid": {reason: invalid[reason] for reason in REASONS},
        "without_object": sum(not row["scored"] for row in rows),
        "objects_without_file": len(wanted - set(files)),
        "rows": rows,
    }


def _error(form: str, path: Path) -> UsageError | None:
    try:
        check_urdf(path) if path.suffix == ".urdf" else READERS[form](path)
    except UsageError as error:
        return error
    return None


@dataclass(frozen=True)
class ImportedActor:
    """Actor that returns the imported prediction for one object."""

    source: str
    """``FORMAT:FOLDER``."""
    object_id: str

    @property
    def name(self) -> str:
        """Name in reports."""
        return self.source

    def predict(self, evidence: Evidence) -> Prediction:
        """Return the joints of the matched parts, in the frame ``o``."""
        form, folder = split_source(self.source)
        stem = file_name(self.object_id)
        path = list_files(folder, SUFFIXES[form]).get(stem)
        if path is None:
            return Prediction(joints=(), rejection=f"no file {stem} in {folder.name}")
        try:
            parts = READERS[form](path)
        except UsageError as error:
            return Prediction(joints=(), rejection=str(error))
        aligned = align(parts, evidence, any_rotation=form == "real2code")
        return Prediction(joints=tuple(aligned.joints()))


@dataclass(frozen=True, eq=False)
class Alignment:
    """Affine map from the frame of an output to ``o``, and the link of each part."""

    parts: Sequence[ImportedPart]
    linear: Array
    """(3, 3)."""
    shift: Array
    """(3,)."""
    links: Sequence[str | None] = field(default=())
    """Name of the matched link of each part."""

    def joints(self) -> list[PredictedJoint]:
        """Return the joints of the moving parts."""
        out = []
        for k, (part, link) in enumerate(zip(self.parts, self.links, strict=True)):
            if part.kind == "fixed" or part.axis is None or part.pivot is None:
                continue
            axis = self.linear @ part.axis
            unit = float(np.linalg.norm(axis)) if part.kind == "prismatic" else 1.0
            # A reflected frame, which aligned boxes cannot show, would turn the other way.
            a, p = normalised(axis), self.linear @ part.pivot + self.shift
            out.append(
                PredictedJoint(
                    part=link or f"{UNMATCHED} {k}",
                    parent=None,
                    kind=part.kind,
                    axis_o=(float(a[0]), float(a[1]), float(a[2])),
                    pivot_o=(float(p[0]), float(p[1]), float(p[2])),
                    lower=None if part.lower is None else unit * part.lower,
                    upper=None if part.upper is None else unit * part.upper,
                )
            )
        return out


def align(parts: Sequence[ImportedPart], evidence: Evidence, *, any_rotation: bool) -> Alignment:
    """Scale and move an output into the box of the object, and match its parts to links.

    Args:
        parts: Parts of the output; the first is the body.
        evidence: Placed parts of the object, with an image if boxes in it are matched.
        any_rotation: Try all 24 rotations of the axes and one scale; else the given frame and its
            half turn about z, with a scale per axis.
    """
    low, high = joint_bounds(evidence.parts)
    corners = np.concatenate([part.corners for part in parts])
    best: tuple[float, Alignment] | None = None
    for rotation in _rotations() if any_rotation else (np.eye(3), np.diag([-1.0, -1.0, 1.0])):
        turned = corners @ rotation.T
        least, most = turned.min(axis=0), turned.max(axis=0)
        factors = (high - low) / np.maximum(most - least, 1e-9)
        if any_rotation:
            span = max(float(np.linalg.norm(most - least)), 1e-9)
            size = float(np.linalg.norm(high - low)) / span
            factors = np.full(3, size)
        linear = factors[:, None] * rotation
        shift = 0.5 * (low + high) - factors * 0.5 * (least + most)
        score, links = _match(parts, linear, shift, evidence, front=not any_rotation)
        if best is None or score > best[0] + BETTER:
            best = (score, Alignment(parts, linear, shift, links))
    assert best is not None
    return best[1]


def _rotations() -> list[Array]:
    """Return the 24 rotations that map axes to axes, the identity first."""
    out = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            if np.linalg.det(R) > 0.0:
                out.append(R)
    return out


def _match(
    parts: Sequence[ImportedPart],
    linear: Array,
    shift: Array,
    evidence: Evidence,
    *,
    front: bool,
) -> tuple[float, list[str | None]]:
    """Return the mean overlap of matched moving parts and the link of each part, one to one."""
    moving = [k for k, part in enumerate(parts) if part.kind != "fixed"]
    links: list[str | None] = [None] * len(parts)
    if not moving:
        return 0.0, links
    boxes = np.stack([_bounds(parts[k].corners @ linear.T + shift) for k in moving])
    true = np.stack([part.bounds for part in evidence.parts])
    overlap = box_overlap(boxes[:, None], true[None], front=front)
    if evidence.camera is not None and all(parts[k].box_px is not None for k in moving):
        overlap = mask_overlap([parts[k] for k in moving], evidence)
    rows, columns = linear_sum_assignment(-overlap)
    for i, j in zip(rows, columns, strict=True):
        if overlap[i, j] >= LEAST_OVERLAP:
            links[moving[i]] = evidence.parts[j].name
    depth = np.abs(boxes[:, None].mean(axis=2) - true[None].mean(axis=2))[..., 0]
    diagonal = float(np.linalg.norm(np.ptp(true.reshape(-1, 3), axis=0)))
    score = overlap[rows, columns].sum() / len(moving) - depth[rows, columns].mean() / diagonal
    return float(score), links


def _bounds(points: Array) -> Array:
    return np.stack([points.min(axis=0), points.max(axis=0)])


def box_overlap(one: Array, two: Array, *, front: bool) -> Array:
    """Return the intersection over union (...) of boxes (..., 2, 3).

    Args:
        one: Lowest and highest corners.
        two: The same; shapes are broadcast.
        front: Compare the outlines seen from the front, along x: panels have no depth.
    """
    axes = slice(1, 3) if front else slice(0, 3)
    low = np.maximum(one[..., 0, axes], two[..., 0, axes])
    high = np.minimum(one[..., 1, axes], two[..., 1, axes])
    common = np.clip(high - low, 0.0, None).prod(axis=-1)
    sizes = [(b[..., 1, axes] - b[..., 0, axes]).prod(axis=-1) for b in (one, two)]
    union = sizes[0] + sizes[1] - common
    return np.asarray(common / np.maximum(union, 1e-12))


def mask_overlap(parts: Sequence[ImportedPart], evidence: Evidence) -> Array:
    """Return the intersection over union (N, P) of boxes in the image and masks of links."""
    camera = evidence.camera
    assert camera is not None
    ids = PartScene(evidence.parts).rasterize(camera).part_ids
    out = np.zeros((len(parts), len(evidence.parts)))
    for i, part in enumerate(parts):
        assert part.box_px is not None
        row, column, height, width = part.box_px
        box = np.zeros(ids.shape, dtype=bool)
        top, left = round(row * camera.height_px), round(column * camera.width_px)
        bottom = round((row + height) * camera.height_px)
        right = round((column + width) * camera.width_px)
        box[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = True
        for j in range(len(evidence.parts)):
            mask = ids == j
            out[i, j] = (box & mask).sum() / max((box | mask).sum(), 1)
    return out
