"""A folder of PartNet-Mobility objects as a library."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from articulate.conversion.provenance import PARTNET_LICENCE
from articulate.errors import AssetError, UsageError, nearest
from articulate.formats.mesh_paths import resolve
from articulate.formats.read_urdf import read_urdf
from articulate.untrusted import load_json_object, read_bounded

URDF_NAME = "mobility.urdf"
"""File that makes a folder an object."""
FILES = (URDF_NAME, "meta.json", "semantics.txt", "bounding_box.json")
"""Files of an object that are copied; the truth ``mobility_v2.json`` is not."""
FOLDERS = ("textured_objs", "images")
"""Folders of an object that are copied."""
SEMANTICS_BYTES = 1_000_000
"""Largest ``semantics.txt`` that is read."""


@dataclass(frozen=True, kw_only=True)
class PartNetPart:
    """One link of an object with its names in the data set."""

    link: str
    """Link of the URDF."""
    joint_type: str
    """Motion in the terms of the data set: hinge, slider, slider+, free, heavy, static."""
    name: str
    """Semantic name: ``door``, ``rotation_door``, ``handle``."""
    meshes: tuple[Path, ...]
    """Mesh files, all in one frame when every joint is at 0."""


class PartNetLibrary:
    """Objects in the subfolders of a folder; an id is the name of a subfolder."""

    source = "PartNet-Mobility"
    licence = PARTNET_LICENCE

    def __init__(self, folder: Path) -> None:
        """List the objects in ``folder``.

        Raises:
            UsageError: ``folder`` contains no object.
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
        """Return the names of the subfolders in the order of their numbers."""
        return self._ids

    def category(self, object_id: str) -> str:
        """Return the category in ``meta.json``, ``"unknown"`` without one."""
        try:
            found = load_json_object(self._at(object_id) / "meta.json").get("model_cat")
        except UsageError:
            return "unknown"
        return found if isinstance(found, str) and found else "unknown"

    def write(self, object_id: str, folder: Path) -> Path:
        """Copy the object into ``folder`` and return the path of its URDF.

        Its truth is not copied; symbolic links are not followed.
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
        """Return the links with geometry, their names and their meshes.

        Raises:
            AssetError: The URDF or a mesh of it cannot be read.
        """
        origin = self._at(object_id)
        urdf = origin / URDF_NAME
        semantics = _semantics(origin / "semantics.txt")
        out = []
        for link in read_urdf(urdf).links.values():
            named = dict.fromkeys(piece.filename for piece in link.visuals if piece.filename)
            if named:
                word, name = semantics.get(link.name, ("static", link.name))
                meshes = tuple(resolve(reference, urdf) for reference in named)
                out.append(PartNetPart(link=link.name, joint_type=word, name=name, meshes=meshes))
        return tuple(out)

    def _at(self, object_id: str) -> Path:
        if object_id not in self._ids:
            near = _near(object_id, self._ids)
            raise AssetError(f"no object {object_id!r} in {self.folder}{near}")
        return self.folder / object_id


def _near(object_id: str, ids: Sequence[str]) -> str:
    """Return the nearest id, or the number of ids: a list of thousands is useless."""
    hint = nearest(object_id, ids)
    few = "did you mean" in hint or len(ids) <= 20
    return hint if few else f"; {len(ids)} are known, {ids[0]} to {ids[-1]}"


def _copied(origin: Path, target: Path) -> None:
    if origin.is_file() and not origin.is_symlink():
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(origin, target)


def _semantics(path: Path) -> dict[str, tuple[str, str]]:
    """Joint type and name by link; other lines are skipped."""
    try:
        lines = read_bounded(path, SEMANTICS_BYTES).decode(errors="replace").splitlines()
    except UsageError:
        return {}
    words = (line.split() for line in lines)
    return {row[0]: (row[1], " ".join(row[2:])) for row in words if len(row) >= 3}
