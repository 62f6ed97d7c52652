"""Images and material libraries that mesh files name."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

import numpy as np
import trimesh
from PIL import Image

from articulate.errors import AssetError
from articulate.untrusted import read_bounded

MAX_IMAGE_BYTES = 100_000_000
"""Largest image file that is read."""
MAX_PIXELS = 40_000_000
"""Largest image that is decoded."""
MAX_LIBRARY_BYTES = 20_000_000
"""Largest material library that is read."""
MAX_BUFFER_BYTES = 300_000_000
"""Largest buffer of a glTF file."""
IMAGE_FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "WEBP", "PPM", "DDS")
"""Formats of images. Pillow starts another program to decode some others."""
MAP_OPTIONS = {
    "-blendu": (1, 1),
    "-blendv": (1, 1),
    "-bm": (1, 1),
    "-boost": (1, 1),
    "-cc": (1, 1),
    "-clamp": (1, 1),
    "-imfchan": (1, 1),
    "-mm": (2, 2),
    "-o": (1, 3),
    "-s": (1, 3),
    "-t": (1, 3),
    "-texres": (1, 1),
    "-type": (1, 1),
}
"""Options of a ``map_`` line and their least and greatest number of values.

Source: Wavefront, "MTL Material Format", version 4.2, 1995.
"""
IMAGE_SUFFIXES = (
    *(".png", ".jpg", ".jpeg", ".bmp", ".gif", ".tga", ".tif", ".tiff", ".webp"),
    *(".ppm", ".pgm", ".dds"),
)
_MAP_LINE = re.compile(r"^([ \t]*map_\w+)[ \t]+([^\r\n]*)", re.MULTILINE | re.IGNORECASE)


def mean_colour(path: Path) -> tuple[float, float, float]:
    """Return the mean red, green and blue of an image file, each in [0, 1].

    Raises:
        AssetError: It cannot be read.
    """
    content = read_bounded(path, MAX_IMAGE_BYTES, error=AssetError)
    try:
        with open_image(content) as image:
            return mean_of(image)
    except ValueError as error:
        raise AssetError(f"texture {path.name}: {error}") from None


def open_image(content: bytes) -> Image.Image:
    """Open an image of one of ``IMAGE_FORMATS``; its pixels are decoded later.

    Raises:
        ValueError: It is not such an image, or has too many pixels.
    """
    try:
        image = Image.open(io.BytesIO(content), formats=IMAGE_FORMATS)
    except Image.DecompressionBombError:
        raise ValueError(f"more than {MAX_PIXELS} pixels") from None
    except (OSError, ValueError, SyntaxError):
        raise ValueError("cannot be read (not an image)") from None
    if image.width * image.height > MAX_PIXELS:
        raise ValueError(f"more than {MAX_PIXELS} pixels")
    return image


def mean_of(image: Image.Image) -> tuple[float, float, float]:
    """Return the mean red, green and blue of an image, each in [0, 1].

    Raises:
        ValueError: It cannot be decoded.
    """
    try:
        pixels = np.asarray(image.convert("RGBA").resize((8, 8)), dtype=np.float64)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        raise ValueError("cannot be read (damaged)") from None
    red, green, blue = pixels[..., :3].reshape(-1, 3).mean(axis=0) / 255.0
    return float(red), float(green), float(blue)


def map_file(words: str) -> str:
    """Return the file name of a ``map_`` line of a material library, without its options.

    Args:
        words: The line after its first word, for example ``-s 2 2 1 my wood.png``.
    """
    rest = words.strip()
    while True:
        option, _, after = rest.partition(" ")
        if option.lower() not in MAP_OPTIONS or not after.strip():
            return rest
        least, most = MAP_OPTIONS[option.lower()]
        rest = after.strip()
        for k in range(most):
            value, _, after = rest.partition(" ")
            if not after.strip() or (k >= least and not _is_number(value)):
                break
            rest = after.strip()


def find_named(folder: Path, name: str) -> Path | None:
    """Return the file that a mesh file names, or None.

    Names with ``..`` reach the folder's parent at most: data sets keep meshes and images in
    sibling folders of an object.

    Args:
        folder: Folder of the file in which the name is.
        name: Relative path. Of an absolute path, as exporters write them, its last part is used.
    """
    text = name.strip().strip('"').replace("\\", "/").removeprefix("file://")
    last = PurePosixPath(text).name
    relative = text if not text.startswith("/") and text[1:2] != ":" else last
    root = Path(os.path.normpath(folder.absolute())).parent
    for candidate in dict.fromkeys((relative, unquote(relative), last)):
        path = Path(os.path.normpath(folder.absolute() / candidate))
        try:
            if candidate and path.is_relative_to(root) and path.exists():
                return folder / candidate
        except (OSError, ValueError):  # a name too long, or with a null byte
            continue
    return None


class MeshFiles(trimesh.resolvers.Resolver):  # type: ignore[misc]  # without types
    """Files that a mesh file names, read through the gate for untrusted files.

    Attributes:
        problems: Names of images that are absent or cannot be read, each with the reason.
    """

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        self.problems: dict[str, str] = {}

    def get(self, key: str) -> bytes:
        """Return the content of the file ``key``; names in material libraries lose options.

        Raises:
            FileNotFoundError: It is absent, or an image that cannot be read.
            AssetError: It is too large, or no regular file.
        """
        path = find_named(self.folder, key)
        if path is None:
            self.problems[key] = "not found"
            raise FileNotFoundError(key)
        suffix = path.suffix.lower()
        if suffix in IMAGE_SUFFIXES:
            try:
                content = read_bounded(path, MAX_IMAGE_BYTES, error=AssetError)
                open_image(content).close()
            except (AssetError, ValueError) as error:
                self.problems[key] = str(error).removeprefix(f"{path}: ")
                raise FileNotFoundError(key) from None
            return content
        limit = MAX_LIBRARY_BYTES if suffix == ".mtl" else MAX_BUFFER_BYTES
        content = read_bounded(path, limit, error=AssetError)
        if suffix != ".mtl":
            return content
        text = content.decode("utf-8", "surrogateescape")
        plain = _MAP_LINE.sub(lambda m: f"{m[1]} {map_file(m[2])}", text)
        return plain.encode("utf-8", "surrogateescape")

    def write(self, name: str, data: str | bytes) -> None:
        """Reject writing: the resolver only reads."""
        raise NotImplementedError

    def namespaced(self, namespace: str) -> MeshFiles:
        """Return the files of a folder below this one."""
        return MeshFiles(self.folder / namespace / "_")

    def keys(self) -> Iterator[str]:
        """Iterate over no names: a folder is not listed."""
        return iter(())


def named_files(path: Path) -> list[Path]:
    """Return the existing files that a mesh file names: material libraries, images and buffers.

    Raises:
        AssetError: The file cannot be read.
    """
    suffix, found = path.suffix.lower(), list[Path | None]()
    if suffix not in {".obj", ".dae", ".gltf"}:
        return []
    content = read_bounded(path, MAX_BUFFER_BYTES, error=AssetError)
    if suffix == ".obj":
        for name in re.findall(rb"^mtllib[ \t]+([^\r\n]*)", content, re.MULTILINE):
            library = find_named(path.parent, os.fsdecode(name))
            found.append(library)
            if library is not None and library.is_file():
                text = os.fsdecode(read_bounded(library, MAX_LIBRARY_BYTES, error=AssetError))
                maps = (map_file(match[2]) for match in _MAP_LINE.finditer(text))
                found += [find_named(library.parent, name) for name in maps]
    else:
        pattern = rb"<init_from>([^<]{1,1000})<|\"uri\"\s*:\s*\"([^\"]{1,500})\""
        for match in re.finditer(pattern, content):
            found.append(find_named(path.parent, os.fsdecode(match.group(1) or match.group(2))))
    return [file for file in dict.fromkeys(found) if file is not None and file.is_file()]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
