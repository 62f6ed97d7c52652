"""The output of another converter is checked like ours, once, and a crash is a row."""

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
    """Rewrite the cabinet for MuJoCo's reader: no package paths, all meshes OBJ.

    With ``solid``, visual meshes collide, as in most data sets.
    """
    text = urdf.read_text().replace("package://little/", "")
    for mesh in (urdf.parent / "meshes").iterdir():
        if mesh.suffix in (".ply", ".stl", ".dae", ".glb"):
            trimesh.load(mesh, force="mesh").export(mesh.with_suffix(".obj"))
            text = text.replace(mesh.name, f"{mesh.stem}.obj")
    if solid:
        visual = re.compile(r"<visual[^>]*>(.*?)</visual>")
        text = visual.sub(r"\g<0><collision>\1</collision>", text)
    urdf.write_text(text)
    return urdf


def jobs_on(folder: Path, source: Path):
    convert(source, folder / "checked/cabinet", CONFIG)

    def make(tool: str):
        row_path = folder / f"{tool}.json"
        return rivals.Job(tool, "cabinet", source, folder / "checked", folder / "tools", row_path)

    return make


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rivals")
    return jobs_on(folder, plain(write_cabinet(folder / "source"), solid=True))


def test_our_conversion_is_checked_without_its_input(job):
    own = job("ours")
    own.run()
    row = json.loads(own.row_path.read_text())
    assert row["good"], row["reason"]
    assert row["opened"] > 0


def test_convex_hulls_of_a_hollow_cabinet_are_found_sealed(job):
    """MuJoCo reads a mesh as its hull; it loads with compiler flags, and its drawers are full."""
    plain = job("mujoco with flags")
    plain.run()
    row = json.loads(plain.row_path.read_text())
    assert row["loads"], row["reason"]
    assert not row["good"], row["failed"]
    assert "cavities" in row["failed"], row["reason"]
    assert row["cavities_min"] < 0.5


def test_parts_that_collide_with_nothing_are_not_good(tmp_path):
    """Nothing blocks a drawer without collision shapes, and nothing can pull it."""
    bare = jobs_on(tmp_path, plain(write_cabinet(tmp_path / "source"), solid=False))
    bare("mujoco with flags").run()
    row = json.loads((tmp_path / "mujoco with flags.json").read_text())
    assert row["loads"], row["reason"]
    assert row["failed"] == [rivals.BARE]
    assert row["reason"] == "drawer, door: no collision shapes"


def test_floor_and_placement_that_a_tool_adds_are_removed(job, tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text("""<mujoco><default><default class="floor"><geom type="plane" size="0 0 1"/>
    </default></default><worldbody><geom name="floor" class="floor"/><light/>
    <body name="base" pos="0 0 3"><freejoint/><geom size="1"/></body></worldbody></mujoco>""")
    asset = load_asset(job("ours").checked / "cabinet")
    frame = InputFrame(scale=1.0, T_os=np.eye(4))
    found = rivals.wrap_model(path, asset, frame, tmp_path / "asset")
    model = mujoco.MjModel.from_xml_path(str(found.folder / "object.xml"))
    assert (model.njnt, model.ngeom) == (0, 1)
    assert model.geom_type[0] == mujoco.mjtGeom.mjGEOM_SPHERE
    assert_allclose(model.body(int(model.geom_bodyid[0])).pos, 0.0)


def test_a_tool_that_cannot_write_next_to_the_urdf_gets_a_folder(tmp_path):
    """urdf-to-mjcf writes elsewhere if its output is in the folder of the URDF."""
    tool = tmp_path / "tools/urdf-to-mjcf/bin/urdf-to-mjcf"
    tool.parent.mkdir(parents=True)
    tool.write_text('#!/bin/sh\n[ "$(dirname "$4")" != "$(dirname "$5")" ] && touch "$4"\n')
    tool.chmod(0o755)
    (tmp_path / "object").mkdir()
    made = rivals.urdf_to_mjcf(tmp_path / "object/a.urdf", tmp_path / "tools")
    assert made.path is not None, made.reason


def test_a_tool_that_fails_gives_the_reason(job):
    failing = job("mujoco")
    made = rivals._run(
        [sys.executable, "-c", "raise SystemExit('no such thing')"], failing.row_path
    )
    assert made.path is None
    assert made.reason == "exit 1: no such thing"


def test_a_row_that_exists_is_not_measured_again(job):
    done = job("done")
    done.row_path.write_text('{"id": "cabinet"}')
    assert done.row() == {"id": "cabinet"}


@pytest.mark.parametrize("written", [False, True])
def test_a_crash_is_a_row(job, monkeypatch, written):
    """The row includes whether the tool had written a model before the crash."""
    crashing = job(f"crashing {written}")
    context = multiprocessing.get_context("fork")
    monkeypatch.setattr(multiprocessing, "get_context", lambda _: context)
    tool = rivals.unmodified if written else lambda *_: os._exit(9)
    monkeypatch.setitem(rivals.TOOLS, crashing.tool, tool)
    monkeypatch.setattr(rivals, "wrap_model", lambda *_: os._exit(9))
    row = crashing.row()
    assert row["made"] is written, row["reason"]
    assert not row["good"], row["failed"]
    assert row["reason"].startswith("exit 9")
    assert json.loads(crashing.row_path.read_text()) == row
