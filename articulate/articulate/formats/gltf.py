"""Checks of the header of a glTF file before its buffers are read."""

from __future__ import annotations

import importlib.util
import struct
from collections.abc import Mapping
from typing import Any

from articulate.errors import AssetError, quote
from articulate.untrusted import parse_json_object

MAX_ITEMS = 9_000_000
"""Most items of an accessor, and of all accessors that primitives use, each time counted."""
MAX_VALUES = 60_000_000
"""Most numbers in all accessors."""
MAX_NODES = 20_000
"""Most nodes, meshes, primitives, accessors, buffers or images."""
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
COMPRESSIONS = {"KHR_draco_mesh_compression": "DracoPy", "EXT_meshopt_compression": ""}
"""Extensions that compress meshes, and the package that reads each."""
GLB_MAGIC = b"glTF"


def check_gltf(content: bytes, name: str) -> None:
    """Reject a glTF or GLB file whose accessors or nodes are too large.

    Accessors without a buffer, and sparse ones, have a size that no part of the file bounds.

    Args:
        content: The file.
        name: Its name, for messages.

    Raises:
        AssetError: It has no JSON header, or a count is missing or too large.
    """
    header = _header(content, name)
    _check_compression(header, name)
    for key in ("nodes", "meshes", "accessors", "bufferViews", "buffers", "images"):
        _check("count", len(_list(header, key, name)), MAX_NODES, key, name)
    _check_trees(_list(header, "nodes", name), name)
    accessors = _list(header, "accessors", name)
    values = 0
    for k, accessor in enumerate(accessors):
        count = _count(accessor.get("count"), k, name)
        _check("count", count, MAX_ITEMS, f"accessor {k}", name)
        values += count * COMPONENTS.get(str(accessor.get("type")), 1)
    _check("number", values, MAX_VALUES, "values in all accessors", name)
    corners = primitives = 0
    for mesh in _list(header, "meshes", name):
        for primitive in _list(mesh, "primitives", name):
            primitives += 1
            attributes = primitive.get("attributes")
            used = [*attributes.values()] if isinstance(attributes, dict) else []
            for index in (*used, primitive.get("indices")):
                if isinstance(index, int) and 0 <= index < len(accessors):
                    corners += _count(accessors[index].get("count"), index, name)
    _check("count", primitives, MAX_NODES, "primitives", name)
    _check("number", corners, 4 * MAX_ITEMS, "items of all primitives", name)


def _header(content: bytes, name: str) -> dict[str, Any]:
    text = content
    if content[:4] == GLB_MAGIC:
        if len(content) < 20:
            raise AssetError(f"mesh {name}: cannot be read (the GLB header is cut off)")
        (length,) = struct.unpack_from("<I", content, 12)
        text = content[20 : 20 + length]
    try:
        plain = text.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise AssetError(f"mesh {name}: cannot be read (its header is not UTF-8)") from None
    return parse_json_object(plain.rstrip("\0 \n\r\t"), f"mesh {name}", error=AssetError)


def _check_compression(header: Mapping[str, Any], name: str) -> None:
    """Reject compressed meshes, whose vertices would all be read as zero."""
    used = header.get("extensionsRequired", [])
    for extension, package in COMPRESSIONS.items():
        if not isinstance(used, list) or extension not in used:
            continue
        if not package:
            raise AssetError(f"mesh {name}: is compressed ({extension}); export it without")
        if importlib.util.find_spec(package) is None:
            raise AssetError(
                f"mesh {name}: is compressed ({extension}); install {package}, or export it without"
            )


def _list(owner: Mapping[str, Any], key: str, name: str) -> list[dict[str, Any]]:
    items = owner.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise AssetError(f"mesh {name}: cannot be read ({key} is not a list of objects)")
    return items


def _check_trees(nodes: list[dict[str, Any]], name: str) -> None:
    """Reject nodes that are not disjoint trees: shared children double at each level."""
    parents: dict[int, int] = {}
    for k, node in enumerate(nodes):
        children = node.get("children", [])
        for child in children if isinstance(children, list) else []:
            if not isinstance(child, int) or not 0 <= child < len(nodes) or child in parents:
                raise AssetError(f"mesh {name}: cannot be read (its nodes are not trees)")
            parents[child] = k
    level = [k for k in range(len(nodes)) if k not in parents]
    reached = 0
    while level:
        reached += len(level)
        level = [child for k in level for child in nodes[k].get("children", [])]
    if reached < len(nodes):
        raise AssetError(f"mesh {name}: cannot be read (its nodes contain themselves)")


def _count(value: Any, k: int, name: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise AssetError(f"mesh {name}: the count of accessor {k} is {quote(value)}")
    return value


def _check(kind: str, value: int, most: int, of: str, name: str) -> None:
    if value > most:
        raise AssetError(f"mesh {name}: the {kind} of {of} is {value}; at most {most} is accepted")
