"""Data sets of objects with known joints.

``DATASET`` of the command is one of: an index file such as ``assets.json``, whose entries name
URDFs and state true joints; a folder of URDFs, whose own joints are the truth; or the name of a
procedural library.
"""

from __future__ import annotations

import importlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from articulate.benchmark.known_joint import KnownJoint, Status
from articulate.benchmark.truth import SCORED_KINDS, TrueObject, joints_in_urdf, true_object
from articulate.errors import AssetError, ConfigError, UsageError, nearest, quote, shorten
from articulate.formats.part_names import semantic_names
from articulate.formats.read_urdf import read_urdf
from articulate.formats.source_object import SourceObject
from articulate.library.library import Library
from articulate.untrusted import load_json_object

LIBRARIES = {
    "procedural": "articulate.library:ProceduralLibrary",
}
"""Procedural libraries by name, imported on use."""
TRUTH = "mobility_v2"
"""Value of ``truth`` in entries of an index that can be scored."""
MAX_ID = 200
"""Longest id of an object."""
INDEX_BYTES = 100_000_000
"""Largest index that is read."""
SEEDS = 5
"""Objects of each category of a procedural library."""


class Dataset(Protocol):
    """Objects with known joints."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def ids(self) -> Sequence[str]:
        """Ids of all objects, in a fixed order."""
        ...

    def known(self, object_id: str) -> Sequence[KnownJoint]:
        """Return the true joints of an object, read without its meshes."""
        ...

    def category(self, object_id: str) -> str:
        """Category of an object."""
        ...

    def load(self, object_id: str) -> TrueObject:
        """Load an object with its parts.

        Raises:
            AssetError: It cannot be read.
        """
        ...


def open_dataset(source: str, data: Path | None = None) -> Dataset:
    """Open the data set that ``source`` names.

    Args:
        source: An index file, a folder, or the name of a library.
        data: Folder that the paths of an index start from; that of the index if None.

    Raises:
        ConfigError: It is none of these.
    """
    if source in LIBRARIES:
        module, _, attribute = LIBRARIES[source].partition(":")
        try:
            library = getattr(importlib.import_module(module), attribute)(SEEDS)
        except ImportError:
            raise ConfigError(f"{source}: this library is not installed") from None
        return LibraryDataset(source, library)
    path = Path(source)
    try:
        is_file, is_folder = path.is_file(), path.is_dir()
    except OSError as error:  # a name that is too long
        raise ConfigError(f"{shorten(source)}: cannot be read ({error.strerror})") from None
    if is_file:
        return IndexDataset(path, data or path.parent)
    if is_folder:
        return FolderDataset(path)
    raise ConfigError(
        f"{source}: neither an index file, nor a folder, nor a library{nearest(source, LIBRARIES)}"
    )


class IndexDataset:
    """Data set of an index file, whose entries have a URDF and true joints."""

    def __init__(self, path: Path, data: Path) -> None:
        self.name = path.name
        self._data = data
        try:
            content = load_json_object(path, limit_bytes=INDEX_BYTES, error=ConfigError)
            entries = [e for e in content["assets"] if e.get("truth") == TRUTH]
        except (KeyError, TypeError, AttributeError) as error:
            raise ConfigError(
                f"{path}: not an index of objects ({type(error).__name__}: {shorten(error)}); "
                'it holds {"assets": [{"id", "path", "truth", "truth_joints"}, …]}'
            ) from None
        self._entries: dict[str, dict[str, Any]] = {}
        for entry in entries:
            _check_entry(path, entry)
            object_id = str(entry["id"])
            if object_id in self._entries:
                raise ConfigError(f"{path}: two entries have the id {object_id}; rename one")
            self._entries[object_id] = entry
        if not self._entries:
            raise ConfigError(f'{path}: no entry has "truth": "{TRUTH}"; there is nothing to score')

    def ids(self) -> Sequence[str]:
        """Return the ids in the order of the file."""
        return list(self._entries)

    def category(self, object_id: str) -> str:
        """Return the category in the index."""
        return str(self._entries[object_id].get("category") or "unknown")

    def known(self, object_id: str) -> Sequence[KnownJoint]:
        """Return the joints in the index, in the frame of the URDF's root."""
        return [_known(joint) for joint in self._entries[object_id]["truth_joints"]]

    def load(self, object_id: str) -> TrueObject:
        """Load an object in the unit of its true joints.

        Some projects scaled the meshes but not the joints. The true joints belong to the meshes as
        they are in their files, so the scale of the URDF is ignored.
        """
        path = self._data / str(self._entries[object_id]["path"])
        return true_object(
            _unscaled(read_urdf(path)),
            self.known(object_id),
            object_id=object_id,
            category=self.category(object_id),
            labels=semantic_names(path.parent),
            in_metres=False,
        )


class FolderDataset:
    """Data set of the URDFs below a folder, whose joints are the truth."""

    def __init__(self, folder: Path) -> None:
        self.name = folder.resolve().name
        paths = sorted(folder.rglob("*.urdf"))
        self._paths = {p.relative_to(folder).with_suffix("").as_posix(): p for p in paths}
        if not paths:
            raise ConfigError(f"{folder}: contains no .urdf; give another folder or an index file")

    def ids(self) -> Sequence[str]:
        """Return the paths without suffix."""
        return list(self._paths)

    def category(self, object_id: str) -> str:
        """Return the category in ``meta.json`` beside the URDF."""
        try:
            meta = load_json_object(self._paths[object_id].parent / "meta.json")
            return str(meta["model_cat"])
        except (UsageError, KeyError):
            return "unknown"

    def known(self, object_id: str) -> Sequence[KnownJoint]:
        """Return the movable joints of the URDF."""
        return joints_in_urdf(read_urdf(self._paths[object_id]))

    def load(self, object_id: str) -> TrueObject:
        """Load an object; those of PartNet-Mobility keep their size, others are scaled."""
        path = self._paths[object_id]
        source = read_urdf(path)
        return true_object(
            source,
            joints_in_urdf(source),
            object_id=object_id,
            category=self.category(object_id),
            labels=semantic_names(path.parent),
            in_metres=path.name != "mobility.urdf",
        )


class LibraryDataset:
    """Data set of a procedural library."""

    def __init__(self, name: str, library: Library) -> None:
        self.name = name
        self._library = library

    def ids(self) -> Sequence[str]:
        """Return the ids of the library."""
        return self._library.ids()

    def category(self, object_id: str) -> str:
        """Return PartNet-Mobility's name of the category."""
        category = getattr(self._library, "category", None)
        return str(category(object_id)) if callable(category) else "unknown"

    def known(self, object_id: str) -> Sequence[KnownJoint]:
        """Return the joints of the URDF that the library writes."""
        with tempfile.TemporaryDirectory() as folder:
            return joints_in_urdf(read_urdf(self._library.write(object_id, Path(folder))))

    def load(self, object_id: str) -> TrueObject:
        """Load an object, scaled to PartNet-Mobility's size."""
        with tempfile.TemporaryDirectory() as folder:
            path = self._library.write(object_id, Path(folder))
            source = read_urdf(path)
            return true_object(
                source,
                joints_in_urdf(source),
                object_id=object_id,
                category=self.category(object_id),
                labels=semantic_names(path.parent),
                in_metres=True,
            )


def _unscaled(source: SourceObject) -> SourceObject:
    """Return the object with all meshes in the size of their files."""
    links = {
        name: replace(
            link,
            visuals=tuple(replace(v, scale=(1.0, 1.0, 1.0)) for v in link.visuals),
            collisions=tuple(replace(c, scale=(1.0, 1.0, 1.0)) for c in link.collisions),
        )
        for name, link in source.links.items()
    }
    return replace(source, links=links)


def _check_entry(path: Path, entry: Mapping[str, Any]) -> None:
    """Reject an entry without an object or joints, before anything is run."""
    if not isinstance(entry.get("id"), (str, int)):
        raise ConfigError(
            f"{path}: an entry has no id ({shorten(dict(entry), 80)}); give each its own id"
        )
    if len(str(entry["id"])) > MAX_ID or not str(entry["id"]).isprintable():
        raise ConfigError(
            f"{path}: the id {quote(str(entry['id']), 40)} is not accepted; an id has at most "
            f"{MAX_ID} printable characters"
        )
    if not isinstance(entry.get("path"), str):
        raise ConfigError(
            f"{path}: entry {entry['id']} has no path; give that of its URDF, from the data folder"
        )
    joints = entry.get("truth_joints")
    if not isinstance(joints, list) or not all(isinstance(joint, dict) for joint in joints):
        raise ConfigError(
            f"{path}: entry {entry['id']} has no truth_joints; give a list with one object for "
            "each joint"
        )


def _known(stated: Mapping[str, Any]) -> KnownJoint:
    try:
        if stated["type"] not in SCORED_KINDS:
            raise ValueError(
                f"its type is {quote(stated['type'])}{nearest(str(stated['type']), SCORED_KINDS)}"
            )
        status = str(stated.get("status", ""))
        kept: Status = "plain"
        if status == "frozen":
            kept = "frozen"
        elif status == "compound":
            kept = "compound"
        return KnownJoint(
            link=str(stated["link"]),
            kind=stated["type"],
            axis_s=_three(stated["axis"]),
            origin_s=_three(stated["origin"]),
            lower=None if stated["lower"] is None else _finite(stated["lower"]),
            upper=None if stated["upper"] is None else _finite(stated["upper"]),
            status=kept,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise AssetError(
            f"a true joint of the index cannot be read ({shorten(error)}): {shorten(dict(stated))}"
        ) from None


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (_finite(v) for v in values)
    return x, y, z


def _finite(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number} is not finite")
    return number
