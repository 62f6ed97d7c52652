"""COLLADA files whose nodes instantiate each other many times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from articulate.errors import AssetError
from articulate.formats import collada as module
from articulate.formats.collada import MAX_INSTANCES, check_instances
from articulate.formats.mesh_file import read_mesh
from articulate.formats.repairs import Repairs

GEOMETRY = """<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="a" count="9">0 0 0 1 0 0 0 1 0</float_array><technique_common>
<accessor source="#a" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries>"""
LEAF = '<node id="n0"><instance_geometry url="#g"/></node>'


def collada(nodes: str, top: str) -> bytes:
    """A file with ``nodes`` in its library whose scene contains ``top``."""
    return (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<asset/>{GEOMETRY}<library_nodes>{nodes}</library_nodes><library_visual_scenes>"
        f'<visual_scene id="s"><node id="r">{instance(top)}</node></visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    ).encode()


def instance(name: str) -> str:
    return f'<instance_node url="#{name}"/>'


def doubled(levels: int) -> bytes:
    """Each node instantiates the one before it twice."""
    nodes = [f'<node id="n{k}">{2 * instance(f"n{k - 1}")}</node>' for k in range(1, levels + 1)]
    return collada(LEAF + "".join(nodes), f"n{levels}")


@pytest.mark.parametrize("levels", [14, 40, 2000])
def test_nodes_that_double_and_double_are_rejected_in_one_line(tmp_path: Path, levels: int) -> None:
    path = tmp_path / "bomb.dae"
    path.write_bytes(doubled(levels))
    with pytest.raises(
        AssetError, match=rf"bomb\.dae: .* more than {MAX_INSTANCES} times"
    ) as found:
        read_mesh(path, Repairs())
    assert "\n" not in str(found.value)


def test_nodes_with_many_instances_are_read(tmp_path: Path) -> None:
    moved = [
        f'<node id="m{k}"><translate>{2 * k} 0 0</translate>{instance("n0")}</node>'
        for k in range(4)
    ]
    path = tmp_path / "row.dae"
    path.write_bytes(collada(f'{LEAF}<node id="all">{"".join(moved)}</node>', "all"))
    groups = read_mesh(path, Repairs())
    left = sorted(float(mesh.bounds[0, 0]) for _, mesh, _ in groups)
    np.testing.assert_allclose(left, [0.0, 2.0, 4.0, 6.0])


@pytest.mark.parametrize(
    "nodes",
    [
        f'<node id="a">{instance("a")}</node>',
        f'<node id="a">{instance("b")}</node>'
        f'<node id="b"><node id="c">{instance("a")}</node></node>',
    ],
)
def test_a_node_that_contains_itself_is_rejected(nodes: str) -> None:
    with pytest.raises(AssetError, match=r"x\.dae: a node contains itself"):
        check_instances(collada(nodes, "a"), "x.dae")


def test_of_nodes_with_one_name_the_largest_counts() -> None:
    bomb = doubled(40).replace(b'<node id="r">', b'<node id="n40"/><node id="r">')
    with pytest.raises(AssetError, match="instantiate each other"):
        check_instances(bomb, "x.dae")


def test_a_chain_may_be_deep() -> None:
    chained = "".join(f'<node id="n{k}">{instance(f"n{k - 1}")}</node>' for k in range(1, 5000))
    check_instances(collada(LEAF + chained, "n4999"), "x.dae")


def test_large_geometry_counts_as_often_as_it_is_instantiated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "MAX_EXPANDED", 5 * 2**3 - 1)
    check_instances(doubled(2), "x.dae")
    with pytest.raises(AssetError, match="too large with all instances"):
        check_instances(doubled(3), "x.dae")


def test_too_many_nodes_are_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_REFERENCES", 30)
    check_instances(collada(50 * LEAF, "n1"), "x.dae")
    with pytest.raises(AssetError, match="more than 30 nodes"):
        check_instances(collada(50 * LEAF, "n0"), "x.dae")
