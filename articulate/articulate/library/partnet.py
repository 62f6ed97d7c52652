"""A folder of PartNet-Mobility objects as a library."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from articulate.conversion.provenance import PARTNET_LICENCE
from articulate.errors import AssetError, UsageError, nearest
from articulate.formats.mesh_paths import resolve
from articulate.formats.read_urdf import read_urdf

URDF_NAME = "mobility.urdf"
"""File that makes a folder an object."""
FILES = (URDF_NAME, "meta.json", "semantics.txt", "bounding_box.json")
"""What is copied of an object, with the folders below; its truth, ``mobility_v2.json``, is not."""
FOLDERS = ("textured_objs", "images")


@dataclass(frozen=True, kw_only=True)
class PartNetPart:
    """One link of an object and what the data set calls it."""

    link: str
    """Link of the URDF."""
    joint_word: str
    """How it moves, in the data set's words: hinge, slider, slider+, free, heavy, static."""
    name: str
    """What it is: ``door``, ``rotation_door``, ``handle``."""
    meshes: tuple[Path, ...]
    """Its mesh files, all in one frame when every joint is at 0."""


class PartNetLibrary:
    """Objects of a folder that holds one folder each; an id is the name of that folder."""

    source = "PartNet-Mobility"
    licence = PARTNET_LICENCE

    def __init__(self, folder: Path) -> None:
        """Look what is there.

        Raises:
            UsageError: ``folder`` holds no object.
        """
        self.folder = folder
        found = sorted(path.parent.name for path in folder.glob(f"*/{URDF_NAME}"))
        if not found:
            raise UsageError(
                f"{folder}: no folder in it holds a {URDF_NAME}; give the folder that holds "
                "the objects of PartNet-Mobility, one folder each"
            )
        self._ids = tuple(sorted(found, key=lambda name: (len(name), name)))

    def ids(self) -> Sequence[str]:
        """Names of the objects' folders, short ones first: the order of their numbers."""
        return self._ids

    def category(self, object_id: str) -> str:
        """The category that ``meta.json`` says, ``"unknown"`` if it says none."""
        try:
            text = (self._at(object_id) / "meta.json").read_text(encoding="utf-8")
            found = json.loads(text).get("model_cat")
        except (OSError, ValueError, AttributeError):
            return "unknown"
        return found if isinstance(found, str) and found else "unknown"

    def write(self, object_id: str, folder: Path) -> Path:
        """Copy the object into ``folder`` and return the path of its URDF.

        Its truth stays behind; links to other places are not followed.
        """
        origin = self._at(object_id)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for name in FILES:
                _copied(origin / name, folder / name)
            for name in FOLDERS:
                for path in sorted((origin / name).glob("*")):
                    _copied(path, folder / name / path.name)
        except OSError as error:
            raise UsageError(f"{folder}: cannot be written ({error.strerror})") from None
        return folder / URDF_NAME

    def parts(self, object_id: str) -> tuple[PartNetPart, ...]:
        """Links with geometry, what they are called, and their meshes.

        Raises:
            AssetError: The URDF or a mesh of it cannot be read.
        """
        origin = self._at(object_id)
        urdf = origin / URDF_NAME
        said = _semantics(origin / "semantics.txt")
        out = []
        for link in read_urdf(urdf).links.values():
            named = dict.fromkeys(piece.filename for piece in link.visuals if piece.filename)
            if named:
                word, name = said.get(link.name, ("static", link.name))
                meshes = tuple(resolve(reference, urdf) for reference in named)
                out.append(PartNetPart(link=link.name, joint_word=word, name=name, meshes=meshes))
        return tuple(out)

    def _at(self, object_id: str) -> Path:
        if object_id not in self._ids:
            near = _near(object_id, self._ids)
            raise AssetError(f"no object {object_id!r} in {self.folder}{near}")
        return self.folder / object_id


def _near(object_id: str, ids: Sequence[str]) -> str:
    """The nearest id, or how many there are: a list of thousands helps nobody."""
    said = nearest(object_id, ids)
    few = "did you mean" in said or len(ids) <= 20
    return said if few else f"; {len(ids)} are known, {ids[0]} to {ids[-1]}"


def _copied(origin: Path, target: Path) -> None:
    if origin.is_file() and not origin.is_symlink():
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(origin, target)


def _semantics(path: Path) -> dict[str, tuple[str, str]]:
    """Joint word and name by link; lines that say something else are passed over."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    words = (line.split() for line in lines)
    return {row[0]: (row[1], " ".join(row[2:])) for row in words if len(row) >= 3}
