import json
import shutil

import pytest
from tests.articulate.conversion.cabinets import write_cabinet

from articulate.commands import run_command
from articulate.commands.check import main

RIGID = """<robot name="stone"><link name="body">
<visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual></link></robot>"""


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """Three objects, of which one is a letter, and the cache of all tests; not to be changed."""
    folder = tmp_path_factory.mktemp("objects")
    write_cabinet(folder / "in")
    (folder / "in" / "stone.urdf").write_text(RIGID)
    (folder / "in" / "letter.urdf").write_text("Dear Sir or Madam\n")
    return folder


@pytest.fixture
def call(objects, tmp_path, monkeypatch, capsys):
    """``call(words)``: exit code, stdout and stderr of ``check-asset words``."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(objects / "cache"))
    monkeypatch.chdir(tmp_path)

    def run(*words):
        capsys.readouterr()
        code = run_command(main, [str(word) for word in words])
        return (code, *capsys.readouterr())

    return run


@pytest.mark.render
def test_one_object_is_converted_checked_and_reported(objects, call, tmp_path):
    source = objects / "in" / "little" / "little.urdf"
    code, out, err = call(source, "--out", "cabinet")
    assert code == 0
    assert err == ""
    assert out.startswith("little: repaired (")
    assert (
        "joint    drawer_joint: slide of 0.3 m (limits 0 to 0.3), free 100%, opened by 30 N" in out
    )
    assert {
        "asset.json",
        "object.xml",
        "object.urdf",
        "meshes",
        "check_report.json",
        "check_report.html",
    } <= {path.name for path in (tmp_path / "cabinet").iterdir()}
    code, out, _ = call(source, "--out", "cabinet", "--json")
    content = json.loads(out)
    assert code == 0
    assert content == json.loads((tmp_path / "cabinet" / "check_report.json").read_text())
    assert set(content) >= {
        "verdict",
        "reasons",
        "repairs",
        "joints",
        "kinematics_max_error_m",
        "cavities_min",
        "colliders",
        "step_us",
        "seconds",
    }
    assert set(content["joints"][0]) >= {"name", "type", "range", "swept", "blocked"}


@pytest.mark.render
def test_a_folder_of_objects_ends_with_a_table_and_an_index(objects, call, tmp_path):
    words = (objects / "in", "--out", "all", "--jobs", "2", "--junit", "report.xml")
    code, out, err = call(*words)
    assert code == 3
    assert err.count("\n") == 3
    assert "3 objects: 0 passed, 2 repaired, 1 rejected" in out
    assert [line.split()[:2] for line in out.splitlines()[1:4]] == [
        ["letter", "rejected"],
        ["little", "repaired"],
        ["stone", "repaired"],
    ]
    assert 'failures="1"' in (tmp_path / "report.xml").read_text()
    assert "letter" in (tmp_path / "all" / "index.html").read_text()
    shutil.rmtree(tmp_path / "all" / "stone")
    code, out, _ = call(*words, "--json")
    content = json.loads(out)
    assert code == 3
    assert [a["name"] for a in content["assets"]] == ["letter", "little", "stone"]
    assert (tmp_path / "all" / "stone" / "object.xml").is_file()


def test_an_unreadable_object_is_rejected_with_three(objects, call):
    code, out, _ = call(objects / "in" / "letter.urdf", "--out", "letter")
    assert code == 3
    assert "letter: rejected" in out
    assert "no XML in it" in out


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ((), "missing: ASSET"),
        (("a.urdf",), "a.urdf: does not exist"),
        (("nowhere.urdf", "--out", "x"), "does not exist"),
        (("nowhere.urdf", "--out", "x", "--jobs", "-1"), "--jobs is -1"),
        (("nowhere.urdf", "--out", "x", "--limit", "0"), "--limit is 0 s"),
        (("nowhere.urdf", "--out", "x", "--limit", "inf"), "--limit is inf s; it must be at most"),
        (("nowhere.urdf", "--out", "x", "--limit", "1e7"), "it must be at most 1000000 s"),
        ((".", "--out", "x" * 300), "cannot be looked up (File name too long)"),
        ((".", "--out", "x", "--junit", "x" * 300), "cannot be looked up (File name too long)"),
        (("x" * 300,), "cannot be looked up (File name too long)"),
        (("x" * 300, "--out", "x"), "cannot be looked up (File name too long)"),
        (
            (".", "--out", "x", "--compare-with", "x" * 300),
            "cannot be looked up (File name too long)",
        ),
        (("--explain", "cavitis", "--json"), "did you mean cavities?"),
        (("--explain", "cavitis"), "did you mean cavities?"),
        (("nowhere.urdf", "--ot", "x"), "did you mean --out?"),
    ],
)
def test_wrong_usage_is_an_error_in_one_line_and_writes_nothing(call, tmp_path, words, text):
    code, out, err = call(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert text in err
    assert list(tmp_path.iterdir()) == []


def test_options_that_the_conversion_rejects_are_wrong_usage(objects, call, tmp_path):
    code, _, err = call(objects / "in" / "stone.urdf", "--out", "x", "--size", "-1")
    assert code == 2
    assert "size is -1.0 m" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("made", "words", "text"),
    [
        (True, ("--size", "0.5"), "--size: made is an asset folder"),
        (True, ("--collada-up", "y"), "--collada-up: made is an asset folder"),
        (True, ("--mesh-dirs", "."), "--mesh-dirs: made is an asset folder"),
        (
            False,
            ("--compare-with", "stone.urdf"),
            "--compare-with: stone.urdf is not an asset folder",
        ),
    ],
)
def test_flags_that_would_change_nothing_are_rejected(objects, call, tmp_path, made, words, text):
    shutil.copy(objects / "in" / "stone.urdf", tmp_path)
    if made:
        (tmp_path / "made").mkdir()
        (tmp_path / "made" / "asset.json").write_text("{}")
    code, out, err = call("made" if made else "stone.urdf", "--out", "x", *words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert text in err
    assert not (tmp_path / "x").exists()


def test_a_check_is_explained(call):
    code, out, _ = call("--explain", "cavities")
    assert code == 0
    assert [p.split(".")[0] for p in out.split("\n\n")[1:]] == [
        "Meaning",
        "Importance",
        "Remedy",
    ]


def test_a_check_is_explained_to_programs(call):
    code, out, _ = call("--explain", "joint_sweep", "--json")
    content = json.loads(out)
    assert code == 0
    assert list(content) == ["check", "means", "matters", "remedy"]
    assert content["check"] == "joint_sweep"
    assert content["means"].startswith("Each joint moves through its range")
