"""Gate in front of the files of an asset folder, which may come from anywhere.

MuJoCo and PyBullet open every path that a model names, and allocate whatever it requests. An asset
folder must therefore be self-contained and of bounded size before either sees it.
"""

from __future__ import annotations

import os
import re
import stat
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from lxml import etree

from articulate.errors import AssetError, quote, shorten
from articulate.untrusted import read_bounded

MODELS = ("object.xml", "object.urdf")
XML_BYTES = 50_000_000
"""Largest MJCF or URDF file that is read."""
FOLDER_BYTES = 2_000_000_000
"""Largest total size of an asset folder."""
MAX_FILES = 20_000
MAX_ELEMENTS = 200_000
MAX_ATTRIBUTES = 200
"""Most attributes of an element; reading them takes quadratic time."""
MOST = {"body": 1000, "link": 1000, "joint": 2000, "geom": 4_000}
"""Most elements of a kind, of those that the processor time of the checks depends on."""
MAX_PIXELS = 8192
"""Largest width and height of a texture [px]."""
MAX_ITERATIONS = 1000
"""Largest number of iterations in the options of a model."""
MIN_STEP_S = 1e-5
"""Smallest time step in the options of a model [s]."""
MAX_RESOLUTION = 256
"""Largest parameter of a built-in mesh."""
FORBIDDEN = frozenset(
    {
        "include",
        "attach",
        "model",
        "plugin",
        "extension",
        "hfield",
        "skin",
        "composite",
        "flexcomp",
        "flex",
        "replicate",
        "size",
        "gazebo",
    }
)
"""Elements that read further files, run code or allocate memory without bound."""
FILE_ATTRIBUTE = re.compile(r"file(name|right|left|up|down|front|back)?$")
FOLDER_ATTRIBUTE = re.compile(r"(mesh|texture|asset)dir$")
PNG = struct.Struct(">16xII")
"""Width and height in the header of a PNG file."""


def check_asset_files(folder: Path) -> None:
    """Reject an asset folder that is not self-contained or is too large.

    Args:
        folder: Asset folder. Links, FIFOs and devices in it are rejected as well.

    Raises:
        AssetError: A file is not regular or not inside the folder, or a limit is exceeded.
    """
    total = count = 0
    for base, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = Path(base, name)
            state = path.lstat()
            if not (stat.S_ISREG(state.st_mode) or stat.S_ISDIR(state.st_mode)):
                kind = "a link" if stat.S_ISLNK(state.st_mode) else "not a regular file"
                raise AssetError(f"{path}: {kind}; an asset folder must hold regular files only")
            total, count = total + state.st_size * stat.S_ISREG(state.st_mode), count + 1
        if total > FOLDER_BYTES or count > MAX_FILES:
            raise AssetError(
                f"{folder}: more than {MAX_FILES} files or {FOLDER_BYTES / 1e9:g} GB, the most "
                "that an asset folder may hold"
            )
    for name in MODELS:
        if (folder / name).exists():
            _check_model(folder / name)


def _check_model(path: Path) -> None:
    """Reject a model with a forbidden element or a reference to a file outside its folder."""
    folders: dict[str, str] = {}
    files: list[tuple[str, str]] = []
    counts: Counter[str] = Counter()
    for tag, attributes in _elements(path):
        counts[tag] += 1
        if counts[tag] > MOST.get(tag, MAX_ELEMENTS):
            raise AssetError(f"{path}: more than {MOST[tag]} elements <{tag}>")
        if tag in FORBIDDEN:
            raise AssetError(f"{path}: element <{tag}> is not accepted in an asset folder")
        if tag == "mesh" and "builtin" in attributes:
            _check_size(path, MAX_RESOLUTION, *attributes.get("params", "").split())
        if tag == "texture":
            _check_size(path, MAX_PIXELS, *(attributes.get(k, "0") for k in ("width", "height")))
        if tag == "option":
            _check_option(path, attributes)
        folders |= {k: v for k, v in attributes.items() if FOLDER_ATTRIBUTE.match(k)}
        files += [(tag, v) for k, v in attributes.items() if FILE_ATTRIBUTE.match(k)]
    for tag, value in files:
        is_texture = tag == "texture"
        inside = folders.get("texturedir" if is_texture else "meshdir", folders.get("assetdir", ""))
        _check_reference(path, inside, value, is_texture=is_texture)


def _elements(path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield name and attributes of the elements of an XML file of bounded size and depth."""
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
    )
    try:
        root = etree.fromstring(read_bounded(path, XML_BYTES, error=AssetError), parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise AssetError(f"{path}: not XML ({shorten(error)})") from None
    if root.getroottree().docinfo.internalDTD is not None:
        raise AssetError(f"{path}: a document type declaration is not accepted")
    for count, element in enumerate(root.iter(etree.Element)):
        if count > MAX_ELEMENTS:
            raise AssetError(f"{path}: more than {MAX_ELEMENTS} elements")
        if len(element.attrib) > MAX_ATTRIBUTES:
            raise AssetError(f"{path}: an element with more than {MAX_ATTRIBUTES} attributes")
        yield etree.QName(element).localname, dict(element.attrib)


def _check_reference(path: Path, inside: str, value: str, *, is_texture: bool) -> None:
    parts = Path(inside, value).parts
    if Path(inside, value).is_absolute() or ".." in parts or ":" in value or "\\" in value:
        raise AssetError(f"{path}: {quote(value)} is outside the asset folder")
    file = path.parent / inside / value
    if is_texture and file.is_file():
        with file.open("rb") as stream:
            header = stream.read(PNG.size)
        if len(header) < PNG.size or not header.startswith(b"\x89PNG"):
            raise AssetError(f"{path}: texture {quote(value)} is not a PNG file")
        _check_size(path, MAX_PIXELS, *PNG.unpack(header))


def _check_option(path: Path, attributes: dict[str, str]) -> None:
    """Reject a time step and numbers of iterations that take processor time without bound."""
    _check_size(path, MAX_ITERATIONS, *(v for k, v in attributes.items() if "iterations" in k))
    step = attributes.get("timestep", "1")
    with suppress(ValueError):  # MuJoCo reports it
        if not float(step) >= MIN_STEP_S:
            raise AssetError(
                f"{path}: a time step of {quote(step)} s; at least {MIN_STEP_S:g} s is accepted"
            )


def _check_size(path: Path, largest: int, *values: str | int) -> None:
    for value in values:
        try:
            number = float(value)
        except ValueError:
            continue  # MuJoCo reports it
        if not number <= largest:
            raise AssetError(f"{path}: {quote(value)} where at most {largest} is accepted")
