"""Checks of a COLLADA file before it is parsed, its unit and its upward axis."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from articulate.errors import AssetError
from articulate.formats.repairs import Repairs
from articulate.formats.xml_input import child_of, children_of, tag_of
from articulate.untrusted import open_regular

MAX_BYTES = 100_000_000
"""Largest COLLADA file that is read."""
MAX_INSTANCES = 20_000
"""Most nodes and pieces of geometry of a scene, each counted as often as it is instantiated."""
MAX_REFERENCES = 1_000_000
"""Most nodes inside others or referenced by them."""
MAX_EXPANDED = 100_000_000
"""Most characters of indices, each counted as often as it is instantiated."""
PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans", "lines", "linestrips")
HEAD_BYTES = 1_000_000
"""The upward axis and the unit are near the start of the file."""

# Element of a third-party library without stubs.
Element = Any
Size = NDArray[np.float64]
"""Nodes and pieces of geometry, and characters of indices (2,); float: they grow exponentially."""


def read_unit(content: bytes, name: str, repairs: Repairs) -> float:
    """Check the markup of a COLLADA file and return the length of its unit [m].

    Args:
        content: The file.
        name: Its name, for messages.
        repairs: Receives notes about the unit and the upward axis.

    Raises:
        AssetError: It is an archive, has entities, or is too large when expanded.
    """
    if content[:2] == b"PK":
        raise AssetError(f"mesh {name}: an archive; unpack it first")
    if len(content) > MAX_BYTES:
        raise AssetError(f"mesh {name}: larger than {MAX_BYTES} bytes, the most of a COLLADA file")
    plain = content.replace(b"\0", b"")  # in any encoding
    if re.search(rb"<!\s*(DOCTYPE|ENTITY|ELEMENT|ATTLIST)", plain, re.IGNORECASE):
        raise AssetError(f"mesh {name}: has a DOCTYPE or entities, which are not accepted")
    check_instances(content, name)
    axis = re.search(rb"<up_axis>\s*([XY]_UP)", plain)
    if axis:
        repairs.note(
            f"mesh {name} declares {axis.group(1).decode()}: coordinates unchanged, as in ROS"
        )
    found = re.search(rb"<unit[^>]{0,200}?meter\s*=\s*[\"']\s*([\d.eE+-]{1,40})", plain)
    unit = float(found.group(1)) if found else 1.0
    if not 1e-6 <= unit <= 1e6 or abs(unit - 1.0) < 1e-9:
        return 1.0
    repairs.note(f"mesh {name} is measured in units of {unit:g} m")
    return unit


def is_z_up(path: Path) -> bool:
    """Return whether the file at ``path`` is a COLLADA mesh with the z axis up."""
    if path.suffix.lower() != ".dae":
        return False
    with open_regular(path, limit_bytes=MAX_BYTES, error=AssetError) as stream:
        axis = re.search(rb"<up_axis>\s*([XYZ]_UP)", stream.read(HEAD_BYTES))
    return axis is not None and axis.group(1) == b"Z_UP"


def check_instances(content: bytes, name: str) -> None:
    """Reject a file that a few nodes, instantiated by each other, expand beyond all limits.

    Args:
        content: The COLLADA file, without entities.
        name: Its name, for the message.

    Raises:
        AssetError: It is too large when expanded, or a node contains itself.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    root = etree.fromstring(content, parser)
    nodes = [e for e in root.iter() if tag_of(e) in {"node", "visual_scene"}]
    children = _children(nodes, name)
    own = _own_sizes(nodes, root)
    sizes: dict[int, Size] = {}
    for k in _children_first(children, name):
        sizes[k] = own[k] + sum((sizes[j] for j in children[k]), np.zeros(2))
        if sizes[k][0] > MAX_INSTANCES:
            raise AssetError(
                f"mesh {name}: its nodes instantiate each other more than {MAX_INSTANCES} times; "
                "export it without instances"
            )
        if sizes[k][1] > MAX_EXPANDED:
            raise AssetError(f"mesh {name}: too large with all instances of its nodes")


def _children(nodes: Sequence[Element], name: str) -> list[list[int]]:
    """Return the nodes that each node contains or instantiates; all of those with one name.

    Raises:
        AssetError: They are too many.
    """
    index = {id(node): k for k, node in enumerate(nodes)}  # the list keeps the elements alive
    by_url: dict[str | None, list[int]] = {}
    for k, node in enumerate(nodes):
        by_url.setdefault(f"#{node.get('id')}", []).append(k)
    out, left = [], MAX_REFERENCES
    for node in nodes:
        own = (index[id(child)] for child in children_of(node, "node"))
        others = (
            k for e in children_of(node, "instance_node") for k in by_url.get(e.get("url"), ())
        )
        out.append(list(islice(chain(own, others), left + 1)))
        left -= len(out[-1])
        if left < 0:
            raise AssetError(
                f"mesh {name}: more than {MAX_REFERENCES} nodes; export it without instances"
            )
    return out


def _own_sizes(nodes: Sequence[Element], root: Element) -> list[Size]:
    """Return the size of each node and its geometry, without its children."""
    geometry: dict[str | None, Size] = {}
    for element in (e for e in root.iter() if tag_of(e) == "geometry"):
        url = f"#{element.get('id')}"
        geometry[url] = np.maximum(geometry.get(url, np.zeros(2)), _size(element))
    none = np.zeros(2)
    return [
        np.array([1.0, 0.0])
        + sum(
            (geometry.get(e.get("url"), none) for e in children_of(node, "instance_geometry")), none
        )
        for node in nodes
    ]


def _size(geometry: Element) -> Size:
    mesh = child_of(geometry, "mesh")
    pieces = [] if mesh is None else [e for e in mesh if tag_of(e) in PRIMITIVES]
    indices = (p for piece in pieces for p in children_of(piece, "p"))
    return np.array([len(pieces), sum(len(p.text or "") for p in indices)], dtype=np.float64)


def _children_first(children: Sequence[Sequence[int]], name: str) -> list[int]:
    """Return the numbers of all nodes, each after its children; without recursion, for depth.

    Raises:
        AssetError: A node contains itself.
    """
    missing = [len(others) for others in children]
    parents: list[list[int]] = [[] for _ in children]
    for k, others in enumerate(children):
        for j in others:
            parents[j].append(k)
    order = [k for k, count in enumerate(missing) if count == 0]
    for k in order:  # grows during the loop
        for j in parents[k]:
            missing[j] -= 1
            if missing[j] == 0:
                order.append(j)
    if len(order) != len(children):
        raise AssetError(f"mesh {name}: a node contains itself, through instance_node")
    return order
