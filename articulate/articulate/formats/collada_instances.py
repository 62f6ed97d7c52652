"""How large a COLLADA file becomes: its nodes may be shown again and again by others."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, islice
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from articulate.errors import AssetError
from articulate.formats.xml_input import child_of, children_of, tag_of

MAX_INSTANCES = 20_000
"""Most nodes and pieces of geometry of a scene, each counted as often as it is shown."""
MAX_SHOWN = 1_000_000
"""Most nodes inside of others or named by them."""
MAX_EXPANDED = 300_000_000
"""Most characters of indices, each counted as often as it is shown."""
PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans", "lines", "linestrips")

# Element of a third-party library without stubs.
Element = Any
Size = NDArray[np.float64]
"""Nodes with pieces of geometry, and characters of indices (2,); float: they double and double."""


def check_instances(content: bytes, name: str) -> None:
    """Refuse a file that a few nodes, shown by each other, make larger than can be read.

    Args:
        content: The COLLADA file; that it has no entities was looked at before.
        name: What the file is called, for the message.

    Raises:
        AssetError: It is too large when expanded, or a node shows itself.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    root = etree.fromstring(content, parser)
    nodes = [e for e in root.iter() if tag_of(e) in {"node", "visual_scene"}]
    shown = _shown(nodes, name)
    own = _own_sizes(nodes, root)
    sizes: dict[int, Size] = {}
    for k in _after_what_they_show(shown, name):
        sizes[k] = own[k] + sum((sizes[j] for j in shown[k]), np.zeros(2))
        if sizes[k][0] > MAX_INSTANCES:
            raise AssetError(
                f"mesh {name}: its nodes show each other more than {MAX_INSTANCES} times; export "
                "it without instances"
            )
        if sizes[k][1] > MAX_EXPANDED:
            raise AssetError(f"mesh {name}: too large with all that its nodes show of each other")


def _shown(nodes: Sequence[Element], name: str) -> list[list[int]]:
    """Which nodes each node shows as part of itself; of several with one name all.

    Raises:
        AssetError: They are too many.
    """
    index = {id(node): k for k, node in enumerate(nodes)}  # the list keeps the elements alive
    called: dict[str | None, list[int]] = {}
    for k, node in enumerate(nodes):
        called.setdefault(f"#{node.get('id')}", []).append(k)
    out, left = [], MAX_SHOWN
    for node in nodes:
        own = (index[id(child)] for child in children_of(node, "node"))
        others = (
            k for e in children_of(node, "instance_node") for k in called.get(e.get("url"), ())
        )
        out.append(list(islice(chain(own, others), left + 1)))
        left -= len(out[-1])
        if left < 0:
            raise AssetError(
                f"mesh {name}: more than {MAX_SHOWN} nodes; export it without instances"
            )
    return out


def _own_sizes(nodes: Sequence[Element], root: Element) -> list[Size]:
    """What each node adds by itself and by its geometry."""
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


def _after_what_they_show(shown: Sequence[Sequence[int]], name: str) -> list[int]:
    """The numbers of all nodes, each after those that it shows; without recursion, for depth.

    Raises:
        AssetError: A node shows itself.
    """
    waits = [len(others) for others in shown]
    shown_by: list[list[int]] = [[] for _ in shown]
    for k, others in enumerate(shown):
        for j in others:
            shown_by[j].append(k)
    order = [k for k, count in enumerate(waits) if count == 0]
    for k in order:  # grows while it is gone through
        for j in shown_by[k]:
            waits[j] -= 1
            if waits[j] == 0:
                order.append(j)
    if len(order) != len(shown):
        raise AssetError(f"mesh {name}: a node shows itself, through instance_node")
    return order
