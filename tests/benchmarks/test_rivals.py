"""What another converter made is judged by the same proof, once, and a crash is a row."""

import json
import multiprocessing
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from tests.articulate.conversion.cabinets import write_cabinet

import rivals
from articulate.assets.asset import load_asset
from articulate.checks.forward_kinematics import InputFrame
from articulate.conversion import ConvertConfig, convert
from articulate.simulator import mujoco

CONFIG = ConvertConfig(decompose=False)


def plain(urdf: Path, *, solid: bool) -> Path:
    """The same cabinet as MuJoCo's own reader takes it: no package paths, all meshes OBJ.

    With ``solid`` what is seen collides, as in most data sets.
    """
    text = urdf.read_text().replace("package://little/", "")
    for mesh in (urdf.parent / "meshes").iterdir():
        if mesh.suffix in (".ply", ".stl", ".dae", ".glb"):
            trimesh.load(mesh, force="mesh").export(mesh.with_suffix(".obj"))
            text = text.replace(mesh.name, f"{mesh.stem}.obj")
    if solid:
        shown = re.compile(r"<visual[^>]*>(.*?)</visual>")
        text = shown.sub(r"\g<0><collision>\1</collision>", text)
    urdf.write_text(text)
    return urdf


def jobs_on(folder: Path, source: Path):
    convert(source, folder / "checked/cabinet", CONFIG)

    def make(tool: str):
        note = folder / f"{tool}.json"
        return rivals.Job(tool, "cabinet", source, folder / "checked", folder / "tools", note)

    return make


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rivals")
    return jobs_on(folder, plain(write_cabinet(folder / "source"), solid=True))


def test_our_own_conversion_is_judged_without_its_input(job):
    own = job("ours")
    own.run()
    row = json.loads(own.note.read_text())
    assert row["good"], row["reason"]
    assert row["opened"] > 0


def test_convex_hulls_of_a_hollow_cabinet_are_found_sealed(job):
    """MuJoCo reads a mesh as its hull; it loads with compiler flags, and its drawers are full."""
    plain = job("mujoco with flags")
    plain.run()
    row = json.loads(plain.note.read_text())
    assert row["loads"], row["reason"]
    assert not row["good"], row["failed"]
    assert "cavities" in row["failed"], row["reason"]
    assert row["cavities_min"] < 0.5


def test_parts_that_collide_with_nothing_are_not_good(tmp_path):
    """Nothing stands in the way of a drawer without collision shapes, and nothing can pull it."""
    bare = jobs_on(tmp_path, plain(write_cabinet(tmp_path / "source"), solid=False))
    bare("mujoco with flags").run()
    row = json.loads((tmp_path / "mujoco with flags.json").read_text())
    assert row["loads"], row["reason"]
    assert row["failed"] == [rivals.BARE]
    assert row["reason"] == "drawer, door: no collision shapes"


def test_floor_and_place_that_a_tool_adds_are_no_part_of_the_object(job, tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text("""<mujoco><default><default class="floor"><geom type="plane" size="0 0 1"/>
    </default></default><worldbody><geom name="floor" class="floor"/><light/>
    <body name="base" pos="0 0 3"><freejoint/><geom size="1"/></body></worldbody></mujoco>""")
    asset = load_asset(job("ours").checked / "cabinet")
    frame = InputFrame(scale=1.0, T_os=np.eye(4))
    found = rivals.adopted(path, asset, frame, tmp_path / "asset")
    model = mujoco.MjModel.from_xml_path(str(found.folder / "object.xml"))
    assert (model.njnt, model.ngeom) == (0, 1)
    assert model.geom_type[0] == mujoco.mjtGeom.mjGEOM_SPHERE
    assert_allclose(model.body(int(model.geom_bodyid[0])).pos, 0.0)


def test_a_tool_that_writes_beside_no_urdf_gets_a_folder(tmp_path):
    """urdf-to-mjcf writes elsewhere if it is asked to write into the folder of the URDF."""
    tool = tmp_path / "tools/urdf-to-mjcf/bin/urdf-to-mjcf"
    tool.parent.mkdir(parents=True)
    tool.write_text('#!/bin/sh\n[ "$(dirname "$4")" != "$(dirname "$5")" ] && touch "$4"\n')
    tool.chmod(0o755)
    (tmp_path / "object").mkdir()
    made = rivals.urdf_to_mjcf(tmp_path / "object/a.urdf", tmp_path / "tools")
    assert made.path is not None, made.reason


def test_a_tool_that_is_not_there_is_a_row_with_the_reason(job):
    absent = job("mujoco")
    made = rivals._run([sys.executable, "-c", "raise SystemExit('no such thing')"], absent.note)
    assert made.path is None
    assert made.reason == "exit 1: no such thing"


def test_a_row_that_is_noted_is_not_made_again(job):
    noted = job("noted")
    noted.note.write_text('{"id": "cabinet"}')
    assert noted.row() == {"id": "cabinet"}


@pytest.mark.parametrize("wrote", [False, True])
def test_a_crash_is_a_row(job, monkeypatch, wrote):
    """It keeps whether the tool had written something before its proof ended."""
    crashing = job(f"crashing {wrote}")
    context = multiprocessing.get_context("fork")
    monkeypatch.setattr(multiprocessing, "get_context", lambda _: context)
    tool = rivals.unmodified if wrote else lambda *_: os._exit(9)
    monkeypatch.setitem(rivals.TOOLS, crashing.tool, tool)
    monkeypatch.setattr(rivals, "adopted", lambda *_: os._exit(9))
    row = crashing.row()
    assert row["made"] is wrote, row["reason"]
    assert not row["good"], row["failed"]
    assert row["reason"].startswith("exit 9")
    assert json.loads(crashing.note.read_text()) == row
