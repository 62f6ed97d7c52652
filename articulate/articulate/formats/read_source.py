"""Find the file of an object and read it, whatever its format."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from articulate.errors import AssetError, quote
from articulate.formats.read_mjcf import read_mjcf
from articulate.formats.read_sdf import CONFIG, file_of_config, read_sdf
from articulate.formats.read_urdf import read_urdf
from articulate.formats.reduce_mjcf import ROOTS
from articulate.formats.source_object import SourceObject
from articulate.formats.xml_input import root_tag

SUFFIXES = (".urdf", ".sdf", ".xml", ".mjcf")
"""Files that may describe an object, those of the first suffix first."""
NOT_OBJECTS = frozenset({"package.xml"})
"""Files in the folders of robots that describe no object."""


def format_of(path: Path) -> Literal["urdf", "mjcf", "sdf"]:
    """Return the format of a file by its root element, whatever its name."""
    tag = root_tag(path)
    return "mjcf" if tag in ROOTS else "sdf" if tag == "sdf" else "urdf"


def read_source(path: Path) -> SourceObject:
    """Read the URDF, SDF or MJCF file at ``path``.

    Raises:
        AssetError: It cannot be read, or describes no object.
    """
    readers = {"urdf": read_urdf, "mjcf": read_mjcf, "sdf": read_sdf}
    return readers[format_of(path)](path)


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
        found = source_files(source)
        urdfs = [path for path in found if path.suffix.lower() == SUFFIXES[0]]
        if not urdfs and (source / CONFIG).is_file():
            return file_of_config(source / CONFIG)
    except OSError as error:  # a name too long, a folder without permission
        name = str(source) if len(str(source)) < 200 else quote(str(source))
        raise AssetError(f"{name}: cannot be read ({error.strerror}); give another") from None
    found = urdfs or found
    if not found:
        raise AssetError(
            f"{source}: holds no URDF, SDF or MJCF file; give one, or a folder with one"
        )
    if len(found) > 1:
        names = ", ".join(path.name for path in found[:6])
        kind = "URDFs" if urdfs else "SDF or MJCF files"
        raise AssetError(f"{source}: holds {len(found)} {kind} ({names}); name one")
    return found[0]


def source_files(folder: Path) -> list[Path]:
    """Return the files directly in ``folder`` that may describe an object, by name."""
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and path.name not in NOT_OBJECTS and path.is_file()
    )
