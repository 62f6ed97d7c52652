"""MJCF that is no object, or is meant to do harm: rejected in one line, in a child process."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from tests.articulate.conversion.mjcf import (
    BALL,
    DRAWER,
    model,
    moving,
    read,
    write,
)

from articulate.conversion import ConvertConfig, convert
from articulate.conversion.convert import input_key, read_input
from articulate.errors import AssetError
from articulate.formats import read_mjcf as reading
from articulate.formats import read_mjcf_child
from articulate.formats.find_source import find_source
from articulate.formats.read_source import format_of, read_source
from articulate.formats.reduce_mjcf import check_native, read_text
from articulate.formats.source_object import SourceGeometry
from articulate.formats.xml_input import root_tag

pytestmark = pytest.mark.usefixtures("quick")

CHAIN = "".join(f'<body name="l{i}"><joint name="q{i}"/>{BALL}' for i in range(5)) + "</body>" * 5
REJECTED = {
    "ball joint": (model(moving(BALL, joint='<joint name="j" type="ball"/>')), "is a ball joint"),
    "several free bodies": (
        model(2 * f"<body><freejoint/>{BALL}</body>"),
        "a scene with 2 free bodies",
    ),
    "robot": (
        model(CHAIN).replace(
            "</worldbody>",
            "</worldbody><actuator>"
            + "".join(f'<motor joint="q{i}"/>' for i in range(5))
            + "</actuator>",
        ),
        "holds a robot",
    ),
    "attached model": (
        model("<attach model='a' body='b' prefix='c'/>"),
        "has another model attached to it",
    ),
    "entities": ('<!DOCTYPE x [<!ENTITY a "b">]>' + model(BALL), "DOCTYPE or entities"),
    "no MJCF": ("<html/>", "not MJCF"),
    "unknown class": (model('<geom class="unknown" size="1"/>'), "MuJoCo does not accept it"),
    "words for numbers": (model('<geom size="one"/>'), "is not made of numbers"),
    "not finite": (model('<geom size="nan"/>'), "is not finite"),
    "undefined mesh": (model('<geom type="mesh" mesh="m"/>'), "mesh 'm' is not defined"),
    "zero axis": (
        model(moving(BALL, joint='<joint axis="0 0 0"/>')),
        "MuJoCo does not accept it",
    ),
    "absent include": (model('<include file="no.xml"/>'), "included file 'no.xml' not found"),
    "global coordinates": (model(BALL, compiler='coordinate="global"'), "coordinate='global'"),
}


@pytest.mark.parametrize("case", REJECTED)
def test_a_file_that_is_not_one_object_is_rejected_in_one_line(tmp_path: Path, case: str) -> None:
    text, reason = REJECTED[case]
    with pytest.raises(AssetError) as caught:
        read(tmp_path, text)
    assert reason in str(caught.value)
    assert str(tmp_path / "thing.xml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_world_without_a_body_makes_no_asset(tmp_path: Path) -> None:
    path = write(tmp_path, model('<light/><geom type="plane" size="1 1 1"/>'))
    with pytest.raises(AssetError, match="no link has geometry"):
        convert(path, tmp_path / "out")


# what a hostile file cannot do


def test_nothing_that_names_a_file_or_a_plugin_reaches_muJoCo(tmp_path: Path) -> None:
    secret = "/etc/passwd"
    head = (
        f'<extension><plugin plugin="{secret}"/></extension><custom><text data="{secret}"/>'
        f'</custom><asset><mesh name="m" file="{secret}" content_type="model/obj"/>'
        f'<texture name="t" file="{secret}"/><hfield name="h" file="{secret}"/>'
        f'<skin file="{secret}"/></asset>'
    )
    text = read_text(write(tmp_path, model('<geom type="mesh" mesh="m"/><site/>', head=head)))
    assert "passwd" not in text.text
    assert "plugin" not in text.text
    with pytest.raises(AssetError, match="format not known"):
        convert(text.path, tmp_path / "out")


@pytest.mark.parametrize("times", [1, 3])
def test_file_that_includes_itself_is_rejected(tmp_path: Path, times: int) -> None:
    text = "<mujoco>" + times * '<include file="thing.xml"/>' + "</mujoco>"
    with pytest.raises(AssetError, match="includes more than 64 files"):
        read(tmp_path, text)


def test_bodies_that_multiply_are_stopped(tmp_path: Path) -> None:
    bomb = BALL
    for _ in range(3):
        bomb = f'<replicate count="60" offset="1 0 0">{bomb}</replicate>'
    with pytest.raises(AssetError, match="more than 20000 elements with <replicate>"):
        read(tmp_path, model(bomb))


def test_bodies_that_multiply_a_little_have_each_a_name(tmp_path: Path) -> None:
    knob = f'<body name="knob" pos="0 0 1"><joint name="turn"/>{BALL}</body>'
    source = read(
        tmp_path, model(f'{BALL}<replicate count="3" offset="0.3 0 0">{knob}</replicate>')
    )
    assert list(source.links) == ["world", "knob0", "knob1", "knob2"]
    np.testing.assert_allclose([j.T_pc[0, 3] for j in source.joints], [0.0, 0.3, 0.6])


@pytest.mark.usefixtures("in_child")
def test_crash_of_the_native_reader_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = write(tmp_path, "import os\nos.abort()\n", "crash.py")
    monkeypatch.setattr(read_mjcf_child, "__file__", str(script))
    with pytest.raises(AssetError, match=r"MuJoCo's reader stopped \(exit -6\)"):
        read(tmp_path, DRAWER)


@pytest.mark.usefixtures("in_child")
def test_reader_that_takes_too_long_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = write(tmp_path, "import time\ntime.sleep(60)\n", "slow.py")
    monkeypatch.setattr(read_mjcf_child, "__file__", str(script))
    monkeypatch.setattr(reading, "TIME_S", 0.3)
    with pytest.raises(AssetError, match=r"MuJoCo took more than 0\.3 s"):
        read(tmp_path, DRAWER)


@pytest.mark.usefixtures("in_child")
def test_the_child_process_returns_the_same_as_this_one(tmp_path: Path) -> None:
    text = read_text(write(tmp_path, DRAWER))
    found = reading.describe_text(text)
    assert found == read_mjcf_child.describe_model(text.text, {})
    assert [body["name"] for body in found["bodies"]] == ["world", "carcass", "drawer"]
    assert found["bodies"][2]["joints"][0]["range"] == [0.0, 0.3]


@pytest.mark.usefixtures("in_child")
def test_an_error_in_the_child_process_is_reported(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="MuJoCo does not accept it"):
        read(tmp_path, model('<geom class="unknown" size="1"/>'))


# which file is meant


def test_root_distinguishes_mjcf_from_urdf_whatever_the_file_is_called(tmp_path: Path) -> None:
    licence = "<!--" + 20_000 * "licence " + "-->"
    assert format_of(write(tmp_path, f"<?xml version='1.0'?>{licence}{DRAWER}", "a.urdf")) == "mjcf"
    assert format_of(write(tmp_path, "<mujocoinclude/>", "b.xml")) == "mjcf"
    assert format_of(write(tmp_path, "<robot name='mujoco'/>", "c.xml")) == "urdf"
    assert root_tag(write(tmp_path, "no XML", "d.xml")) == ""
    assert root_tag(tmp_path / "absent.xml") == ""


def test_folder_with_one_xml_is_that_object_and_with_two_none(tmp_path: Path) -> None:
    path = write(tmp_path, DRAWER, "little/object.xml")
    assert find_source(path.parent) == path
    write(tmp_path, DRAWER, "little/other.mjcf")
    with pytest.raises(AssetError, match=r"holds 2 SDF or MJCF files \(object.xml, other.mjcf\)"):
        find_source(path.parent)
    urdf = write(tmp_path, "<robot name='r'/>", "little/r.urdf")
    assert find_source(path.parent) == urdf


def test_key_of_an_input_knows_when_an_included_file_changes(tmp_path: Path) -> None:
    inner = write(tmp_path, f"<mujocoinclude>{moving(BALL)}</mujocoinclude>", "inner.xml")
    path = write(tmp_path, model('<include file="inner.xml"/>'))
    config = ConvertConfig()
    first = input_key(read_input(path, config), config)
    assert input_key(read_input(path, config), config) == first
    inner.write_text(inner.read_text().replace("0.2 0 0.3", "0.2 0 0.4"))
    assert input_key(read_input(path, config), config) != first


def test_geometry_has_file_and_line(tmp_path: Path) -> None:
    source = read(tmp_path, DRAWER)
    first: SourceGeometry = source.links["drawer"].visuals[0]
    assert first.where == f"{tmp_path / 'thing.xml'}:14 (geom 3)"


SIZES = {
    "memory": '<size memory="1T"/>',
    "user data": '<size nuserdata="1000000000"/>',
    "stack": '<size nstack="4000000000"/>',
    "height field": '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
    "texture": '<asset><texture name="t" builtin="flat" width="60000" height="60000"/></asset>',
    "numbers": '<custom><numeric name="n" size="900000000"/></custom>',
}


@pytest.mark.parametrize("case", SIZES)
def test_sizes_do_not_reach_muJoCo_and_are_rejected_where_it_reads_the_file(
    tmp_path: Path, case: str
) -> None:
    path = write(tmp_path, model(moving(BALL), head=SIZES[case]))
    assert list(read(tmp_path, path.read_text()).links) == ["base", "part"]
    with pytest.raises(AssetError, match="more than 3e"):
        check_native(path)


@pytest.mark.parametrize(
    "head",
    [
        '<asset><texture name="t" type="2d" file="pipe"/></asset>',
        '<asset><mesh name="m" file="pipe"/></asset>',
        '<compiler assetdir="sub"/><asset><hfield name="h" file="pipe" size="1 1 1 1"/></asset>',
        '<asset><skin file="pipe"/></asset>',
    ],
)
def test_special_files_do_not_block(tmp_path: Path, head: str) -> None:
    (tmp_path / "sub").mkdir()
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "sub" / "pipe")
    path = write(tmp_path, model(moving(BALL), head=head))
    read(tmp_path, path.read_text())
    with pytest.raises(AssetError, match="pipe: not a regular file"):
        check_native(path)


def test_a_fifo_or_a_device_as_the_file_or_an_include_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "zero.xml").symlink_to("/dev/zero")
    for name in ("pipe.xml", "zero.xml"):
        with pytest.raises(AssetError, match="not a regular file"):
            read_source(tmp_path / name)
        with pytest.raises(AssetError, match=f"included file '{name}' not found"):
            read(tmp_path, model(f'{BALL}<include file="{name}"/>'))


def test_files_without_harm_are_read_by_muJoCo(tmp_path: Path) -> None:
    head = '<size memory="10M" njmax="500"/><asset><texture name="t" type="2d" file="no.png"/>'
    check_native(write(tmp_path, model(BALL, head=head + "</asset>")))


@pytest.mark.parametrize("count", [401, 15_000])
def test_too_many_bodies_or_joints_are_rejected(tmp_path: Path, count: int) -> None:
    bodies = f'<body><joint type="slide"/>{BALL}</body>' * count
    with pytest.raises(AssetError, match="more than 400 bodies"):
        read(tmp_path, model(bodies))
