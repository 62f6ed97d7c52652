"""Files of an asset folder are regular, inside the folder and of bounded size."""

from __future__ import annotations

import os
import struct

import pytest
from tests.assets import make_cabinet

from articulate.assets.asset_files import check_asset_files
from articulate.errors import AssetError


@pytest.fixture
def folder(tmp_path):
    return make_cabinet(tmp_path / "cabinet").folder


def with_element(folder, element):
    path = folder / "object.xml"
    path.write_text(path.read_text().replace("<worldbody>", f"{element}<worldbody>", 1))


def test_an_asset_folder_of_ours_is_accepted(folder):
    check_asset_files(folder)


@pytest.mark.parametrize(
    "element",
    [
        '<include file="/etc/passwd"/>',
        '<include file="other.xml"/>',
        '<asset><model name="a" file="b.xml"/></asset>',
        '<asset><mesh name="a" file="/etc/passwd"/></asset>',
        '<asset><mesh name="a" file="../../secret.obj"/></asset>',
        '<asset><texture name="a" type="2d" file="/etc/passwd"/></asset>',
        '<asset><texture name="a" type="cube" fileright="../a.png"/></asset>',
        '<compiler meshdir="/etc"/><asset><mesh name="a" file="passwd"/></asset>',
        '<asset><hfield name="a" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
        '<asset><texture name="a" builtin="flat" width="100000" height="100000"/></asset>',
        '<asset><mesh name="a" builtin="torus" params="100000 1 1"/></asset>',
        '<size nuserdata="2000000000"/>',
        '<size memory="1T"/>',
        '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>',
        '<worldbody><replicate count="1000000000"><geom size="1"/></replicate></worldbody>',
    ],
)
@pytest.mark.parametrize("file", ["object.xml"])
def test_a_model_that_reads_elsewhere_or_is_unbounded_is_rejected(folder, element, file):
    with_element(folder, element)
    with pytest.raises(AssetError) as caught:
        check_asset_files(folder)
    line = str(caught.value).replace(str(folder), "")
    assert len(line) < 300
    assert "root:" not in line  # nothing of the other file


def test_a_urdf_that_names_a_mesh_elsewhere_is_rejected(folder):
    (folder / "object.urdf").write_text(
        '<robot name="a"><link name="b"><visual><geometry>'
        '<mesh filename="/etc/passwd"/></geometry></visual></link></robot>'
    )
    with pytest.raises(AssetError, match="outside the asset folder"):
        check_asset_files(folder)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "<mujoco>",
        '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><mujoco>&b;</mujoco>',
        "<a>" * 100_000,
    ],
)
def test_text_that_is_no_plain_xml_is_rejected(folder, text):
    (folder / "object.xml").write_text(text)
    with pytest.raises(AssetError):
        check_asset_files(folder)


def test_a_texture_is_a_png_of_bounded_size(folder):
    with_element(folder, '<asset><texture name="a" type="2d" file="a.png"/></asset>')
    file = folder / "a.png"
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 60_000, 60_000))
    with pytest.raises(AssetError, match="60000 where at most"):
        check_asset_files(folder)
    file.write_bytes(b"GIF89a")
    with pytest.raises(AssetError, match="not a PNG"):
        check_asset_files(folder)


@pytest.mark.parametrize("kind", ["link", "link to a folder", "fifo"])
def test_links_and_pipes_are_rejected(folder, tmp_path, kind):
    path = folder / "meshes" / "z.obj"
    path.parent.mkdir(exist_ok=True)
    if kind == "fifo":
        os.mkfifo(path)
    else:
        path.symlink_to("/etc/passwd" if kind == "link" else "/etc")
    with pytest.raises(AssetError, match="regular"):
        check_asset_files(folder)
