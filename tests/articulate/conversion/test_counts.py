from __future__ import annotations

from pathlib import Path

from tests.articulate.conversion.boxes import made

from articulate.assets.check_report import Counts
from articulate.conversion.convert import counts_of
from articulate.formats.read_source import read_source


def test_links_joints_and_geometry_are_counted_in_and_out(tmp_path: Path) -> None:
    tip = (
        '<link name="tip"><visual><geometry><sphere radius="0.02"/></geometry></visual>'
        '<collision><geometry><sphere radius="0.02"/></geometry></collision></link>'
        '<joint name="hold" type="fixed"><parent link="drawer"/><child link="tip"/></joint></robot>'
    )
    asset = made(tmp_path, ("</robot>", tip))
    found = counts_of(read_source(tmp_path / "two.urdf"), asset)
    assert found == Counts(
        links=(3, 2), joints=(1, 1), visuals=(3, 3), collisions=(1, found.collisions[1])
    )
    assert found.collisions[1] >= 2


def test_what_was_left_out_shows_in_the_counts(tmp_path: Path) -> None:
    leaf = (
        '<link name="leaf"/><joint name="a" type="continuous"><parent link="body"/>'
        '<child link="leaf"/></joint></robot>'
    )
    asset = made(tmp_path, ("</robot>", leaf))
    found = counts_of(read_source(tmp_path / "two.urdf"), asset)
    assert found.joints == (2, 1)
    assert found.links == (3, 2)
