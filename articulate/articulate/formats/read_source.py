"""Read the file of an object, whatever its format."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from articulate.formats.read_mjcf import read_mjcf
from articulate.formats.read_sdf import read_sdf
from articulate.formats.read_urdf import read_urdf
from articulate.formats.reduce_mjcf import ROOTS
from articulate.formats.source_object import SourceObject
from articulate.formats.xml_input import root_tag


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
