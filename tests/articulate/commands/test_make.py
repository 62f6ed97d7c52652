from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from articulate import commands
from articulate.assets.asset import load_asset
from articulate.commands import console
from articulate.commands import make as module
from articulate.commands.make import main
from articulate.reconstruct import query
from articulate.reconstruct.images import view_camera
from articulate.reconstruct.make import overlap
from articulate.reconstruct.part_set import library_part_set
from articulate.reconstruct.program.program_parts import parts_of
from articulate.reconstruct.program.result import ProgramObject
from articulate.reconstruct.program.run import run_program
from articulate.render.camera import FRONT_EYE_W, FRONT_TARGET_W
from articulate.render.scene import PartScene


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch, cache):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    yield
    console.set_level(console.NORMAL)  # -q holds for the process otherwise, and for its other tests


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A drawer of the library, made from a sentence; exit code, folder, what was printed."""
    out = tmp_path_factory.mktemp("made") / "asset"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(out.parent / "cache"))
        printed = ["--text", "a cabinet with one drawer", "--library", "cabinet:3"]
        code = main([*printed, "--out", str(out), "-q"])
    return code, out


def test_a_checked_urdf_is_made_with_its_report_and_its_trace(result):
    code, out = result
    assert code == 0
    asset = load_asset(out)
    assert [joint.kind for joint in asset.joints] == ["slide"]
    assert asset.licence == "MIT"
    assert asset.category == "StorageFurniture"
    assert json.loads((out / "check_report.json").read_text())["verdict"] == "passed"
    content = json.loads((out / "made.json").read_text())
    assert (content["verdict"], content["reasons"]) == ("passed", [])
    assert content["urdf"] == str(out / "object.urdf")
    assert (out / "object.urdf").is_file()
    assert [joint["type"] for joint in content["joints"]] == ["prismatic"]


def test_the_program_beside_it_compiles_to_the_same_joints(result):
    _, out = result
    source = (out / "program" / "program.py").read_text()
    built = run_program(source, parts_of(out / "program" / "object.urdf"))
    assert isinstance(built, ProgramObject)
    assert [(j.kind, j.child) for j in built.joints] == [("prismatic", "drawer_0")]


def test_the_trace_needs_no_other_file_and_links_to_the_report(result):
    _, out = result
    text = (out / "trace.html").read_text()
    assert set(re.findall(r'href="([^"]*)"', text)) == {"check_report.html", "program/program.py"}
    assert not re.search(r'(src|url)=?[("\']+(?!data:)\w', text)
    for printed in (
        "Input",
        "prismatic",
        "sandbox",
        "root(",
        "Checks of the asset",
        "geometric-text",
    ):
        assert printed in text
    assert text.count("data:image/png") >= 1


def test_a_wrong_count_makes_it_doubtful_and_an_earlier_result_is_replaced(
    result, tmp_path, capsys
):
    shutil.copytree(result[1], tmp_path / "asset")
    words = ["--text", "a cabinet with four drawers", "--library", "cabinet:3"]
    assert main([*words, "--out", "asset", "--json"]) == 3
    content = json.loads(capsys.readouterr().out)
    assert content == json.loads((tmp_path / "asset" / "made.json").read_text())
    assert content["verdict"] == "doubtful"
    assert content["reasons"] == ["the text names 4 drawers, the parts include 1"]
    assert "may not be the intended one" in (tmp_path / "asset" / "trace.html").read_text()


def box(low, high):
    mesh = trimesh.creation.box(np.subtract(high, low))
    mesh.apply_translation(0.5 * np.add(low, high))
    return mesh


@pytest.fixture
def stuck(tmp_path):
    """A drawer in a closed case that it nearly fills: it can go nowhere."""
    (tmp_path / "parts").mkdir()
    walls = [box((-0.3, -0.3, z), (0.3, 0.3, z + 0.02)) for z in (0.0, 0.58)]
    walls += [box((x, -0.3, 0.0), (x + 0.02, 0.3, 0.6)) for x in (-0.3, 0.28)]
    walls += [box((-0.3, y, 0.0), (0.3, y + 0.02, 0.6)) for y in (-0.3, 0.28)]
    trimesh.util.concatenate(walls).export(tmp_path / "parts" / "body.obj")
    drawer = box((-0.26, -0.26, 0.04), (0.26, 0.26, 0.5))
    drawer.export(tmp_path / "parts" / "drawer.obj")
    return tmp_path / "parts"


@pytest.mark.slow
@pytest.mark.usefixtures("stuck")
def test_a_drawer_that_runs_into_its_case_is_doubtful(tmp_path):
    assert main(["--text", "a case", "--parts", "parts", "--out", "asset", "-q"]) == 3
    content = json.loads((tmp_path / "asset" / "made.json").read_text())
    assert content["reasons"] == ["the actor has little confidence in drawer (0.20)"]


def test_what_cannot_be_checked_is_written_and_marked(tmp_path, capsys):
    (tmp_path / "parts").mkdir()
    box((-0.3, -0.3, 0.0), (0.3, 0.3, 0.3)).export(tmp_path / "parts" / "body.obj")
    box((-0.3, -0.3, 0.31), (0.3, 0.3, 0.5)).export(tmp_path / "parts" / "drawer.obj")
    words = ["--text", "a box", "--parts", "parts", "--out", "asset", "-q"]
    assert main([*words, "--actor", "tests.articulate.reconstruct.downwards:Downwards"]) == 3
    assert "asset: rejected" in capsys.readouterr().out
    content = json.loads((tmp_path / "asset" / "made.json").read_text())
    assert content["verdict"] == "rejected"
    assert content["urdf"] is None
    assert "drawer" in content["reasons"][0]
    assert (tmp_path / "asset" / "program" / "object.urdf").is_file()
    assert "failed its checks" in (tmp_path / "asset" / "trace.html").read_text()


def test_a_image_is_compared_with_the_parts(capsys):
    part_set = library_part_set("cabinet:3")
    camera = view_camera(part_set.meshes, {})
    cv2.imwrite("seen.png", PartScene(part_set.meshes).render_image(camera)[..., ::-1])
    seen = query.image_query(Path("seen.png"))
    assert overlap(seen, part_set, camera) > 0.95
    # The benchmark's camera, which is the usual one, did not take it.
    assert main(["--image", "seen.png", "--library", "cabinet:3", "--out", "asset", "-q"]) == 3
    assert "image and parts overlap" in capsys.readouterr().out


@pytest.mark.slow
def test_only_the_joint_that_is_requested_moves(tmp_path):
    words = ["--text", "a cabinet", "--library", "cabinet:5", "--out", "asset", "-q"]
    main(words)
    everything = json.loads((tmp_path / "asset" / "made.json").read_text())["joints"]
    assert len(everything) > 1
    main([*words, "--joint", everything[1]["part"]])
    content = json.loads((tmp_path / "asset" / "made.json").read_text())
    assert content["joints"] == [everything[1]]


def test_an_object_is_generated_from_text(tmp_path, capsys):
    text = "a box with a lid, 40 x 30 x 20 cm, with a sticker"
    assert main(["--text", text, "--out", "asset", "--json"]) == 3
    content = json.loads(capsys.readouterr().out)
    written = json.loads((tmp_path / "asset" / "made.json").read_text())
    assert content == written
    assert content["verdict"] == "doubtful"
    assert content["reasons"] == ["not understood: sticker"]
    assert content["check_verdict"] == "passed"
    assert content["category"] == "Box"
    assert content["program"] is None
    (joint,) = content["joints"]
    assert (joint["part"], joint["type"], joint["evidence"]) == ("lid", "revolute", "text")
    asset = load_asset(tmp_path / "asset")
    assert asset.category == "Box"
    np.testing.assert_allclose(np.abs(asset.joints[0].axis_o), np.abs(joint["axis"]), atol=1e-6)
    page = (tmp_path / "asset" / "trace.html").read_text()
    assert "Content of the text" in page
    assert "sticker" in page


@pytest.mark.usefixtures("stuck")
@pytest.mark.parametrize(
    "argv",
    [
        [],
        ["--video", "no.mp4"],
        ["--text", "hello"],
        ["--text", "a box", "--actor", "vlm"],
        ["--text", "a box", "--joint", "lid"],
        ["--text", "a box", "--dry-run"],
        ["--text", "a box", "--size", "50"],
        ["--image", "no.png"],
        ["--text", "", "--library", "cabinet"],
        ["--text", "a box", "--library", "cabnet"],
        ["--text", "a box", "--library", "cabinet", "--parts", "parts"],
        ["--video", "no.mp4", "--library", "cabinet"],
        ["--video", "a.mp4", "--image", "a.png", "--library", "cabinet"],
        ["--image", "no.png", "--library", "cabinet"],
        ["--text", "a box", "--parts", "nowhere"],
        ["--text", "a box", "--parts", "parts", "--joint", "drawr"],
        ["--text", "a box", "--parts", "parts", "--joint", "body"],
        ["--text", "a box", "--parts", "parts", "--actor", "geometric-txt"],
        ["--text", "a box", "--parts", "parts", "--actor", "geometric-video"],
        ["--text", "a box", "--parts", "parts", "--iterations", "0"],
        ["--text", "a box", "--parts", "parts", "--seed", "-1"],
        ["--text", "a box", "--parts", "parts", "--limit", "0"],
        ["--text", "a box", "--parts", "parts", "--limit", "inf"],
        ["--text", "a box", "--parts", "parts", "--camera-fovy", "0"],
        ["--text", "a box", "--parts", "parts", "--camera-file", "no.json"],
        ["--text", "a box", "--parts", "parts", "--out", "parts"],
        ["--text", "a box", "--parts", "parts", "--prts", "parts"],
        ["--text", "a box", "--nonsense"],
        ["--image", "parts"],
        ["--text", "a cabinet", "--size", "0.9"],
        ["--text", "a box", "--parts", "parts", "--size", "0.9"],
        ["--text", "a box", "--library", "cabinet:x"],
    ],
    ids=" ".join,
)
def test_what_cannot_be_made_is_rejected_and_nothing_is_written(argv, error_line, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    error_line(f"articulate make {' '.join(argv)}".strip(), lambda: main(argv))
    assert sorted(tmp_path.rglob("*")) == before


def test_names_that_mean_nothing_are_rejected(tmp_path, error_line):
    (tmp_path / "parts").mkdir()
    for name, x in (("thing", 0.0), ("other", 0.2)):
        box((x, 0, 0), (x + 0.2, 0.2, 0.2)).export(tmp_path / "parts" / f"{name}.obj")
    call = ["--text", "a box", "--parts", "parts"]
    error_line("articulate make --text 'a box' --parts unnamed", lambda: main(call))


def test_the_command_is_found_by_its_name_and_ends_with_2(capsys):
    assert commands.main(["make", "--text", "hello"]) == 2
    reports = capsys.readouterr()
    assert reports.out == ""
    assert reports.err.startswith("'hello': names no object")
    assert reports.err.count("\n") == 1


@pytest.mark.parametrize("out", [".", "..", "../here"])
def test_a_dry_run_writes_its_page_beside_the_folder_whatever_that_is_called(
    tmp_path, monkeypatch, out
):
    (tmp_path / "up" / "here").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "up" / "here")
    words = ["--text", "a cabinet", "--library", "cabinet:3", "--actor", "vlm", "--dry-run", "-q"]
    assert main([*words, "--out", out]) == 0
    (page,) = tmp_path.rglob("*.prompts.html")
    assert page == tmp_path / {"..": "up.prompts.html"}.get(out, "up/here.prompts.html")


def test_every_flag_has_a_word_of_help(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    assert "Example: articulate make" in capsys.readouterr().out


def test_the_camera_that_is_written_out_for_help_is_the_benchmarks():
    assert module.FRONT_EYE == FRONT_EYE_W
    assert module.FRONT_TARGET == FRONT_TARGET_W
    assert pytest.approx(query.QueryCamera().fovy) == module.FRONT_FOVY
