"""Find the file of an object in a folder; nothing here imports a mesh library or a simulator."""

from __future__ import annotations

import re
from pathlib import Path

from articulate.errors import AssetError, quote
from articulate.formats.repairs import Repairs
from articulate.formats.xml_input import Element, children_of, read_markup

SUFFIXES = (".urdf", ".sdf", ".xml", ".mjcf")
"""Files that may describe an object, those of the first suffix first."""
NOT_OBJECTS = frozenset({"package.xml"})
"""Files in the folders of robots that describe no object."""
CONFIG = "model.config"
"""File of a model's folder that names its SDF files by version."""


def find_source(source: Path) -> Path:
    """Return the file of the object that ``source`` is or contains.

    Of a folder this is its only URDF; without one the SDF that its ``model.config`` names; else
    its only SDF or MJCF file.

    Raises:
        AssetError: There is none, or more than one, or the folder cannot be read.
    """
    try:
        if not source.exists():
            raise AssetError(
                f"{source}: does not exist; give a URDF, SDF or MJCF file, or a folder with one"
            )
        if not source.is_dir():
            return file_of_config(source) if source.name == CONFIG else source
        found = objects_in(source)
    except OSError as error:  # a name too long, a folder without permission
        name = str(source) if len(str(source)) < 200 else quote(str(source))
        raise AssetError(f"{name}: cannot be read ({error.strerror}); give another") from None
    if not found:
        raise AssetError(
            f"{source}: holds no URDF, SDF or MJCF file; give one, or a folder with one"
        )
    if len(found) > 1:
        names = ", ".join(path.name for path in found[:6])
        kind = "URDFs" if found[0].suffix.lower() == SUFFIXES[0] else "SDF or MJCF files"
        raise AssetError(f"{source}: holds {len(found)} {kind} ({names}); name one")
    return found[0]


def objects_in(folder: Path) -> list[Path]:
    """Return the files directly in ``folder`` of which each may be the object of the folder.

    These are its URDFs; without any, the SDF file that its ``model.config`` names; else all.

    Raises:
        AssetError: The ``model.config`` cannot be read.
    """
    found = source_files(folder)
    urdfs = [path for path in found if path.suffix.lower() == SUFFIXES[0]]
    if not urdfs and (folder / CONFIG).is_file():
        return [file_of_config(folder / CONFIG)]
    return urdfs or found


def source_files(folder: Path) -> list[Path]:
    """Return the files directly in ``folder`` that may describe an object, by name."""
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and path.name not in NOT_OBJECTS and path.is_file()
    )


def file_of_config(config: Path) -> Path:
    """Return the SDF file of the newest version that a ``model.config`` names.

    Raises:
        AssetError: It names none, or one outside its folder.
    """
    root = read_markup(config, Repairs())
    named = [
        (sdf_version(element), (element.text or "").strip())
        for element in children_of(root, "sdf")
        if (element.text or "").strip()
    ]
    if not named:
        raise AssetError(f"{config}: names no SDF file; give the .sdf file itself")
    name = max(named)[1]
    path = config.parent / name
    if Path(name).name != name or not path.is_file():
        raise AssetError(f"{config}: names {quote(name)}, which is not in its folder")
    return path


def sdf_version(element: Element) -> int:
    """Return the minor version of SDF 1.x, 7 where there is none."""
    found = re.match(r"1\.(\d{1,2})", (element.get("version") or "").strip())
    return int(found.group(1)) if found else 7
