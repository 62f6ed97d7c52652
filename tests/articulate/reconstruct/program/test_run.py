"""From source to data or to a sentence, through the real child process."""

import json
import math
import time

import numpy as np
import pytest
from tests.articulate.reconstruct.program import scenes

from articulate.errors import AssetError
from articulate.reconstruct.program import api, run
from articulate.reconstruct.program.contact_distance import contact_along
from articulate.reconstruct.program.program_parts import parts_of
from articulate.reconstruct.program.result import ProgramError, ProgramObject
from articulate.reconstruct.program.run import run_program
from articulate.reconstruct.program.sandbox import SandboxLimits


@pytest.fixture(scope="module")
def parts():
    return parts_of(scenes.parts())


def test_a_program_becomes_poses_and_joints(parts):
    built = scenes.built(scenes.PROGRAM, parts)
    assert built.root == "body"
    joints = {joint.name: joint for joint in built.joints}
    hinge = joints["door_hinge"]
    assert (hinge.kind, hinge.child, hinge.parent) == ("revolute", "door", "body")
    assert hinge.axis_w == (0.0, 0.0, -1.0)
    assert hinge.pivot_w == pytest.approx((0.2, -0.25, 0.55))
    assert hinge.lower == 0.0
    assert hinge.upper == pytest.approx(math.radians(100))
    assert joints["drawer_joint"].upper == 0.3
    where = {part.name: np.array(part.pos_w) for part in built.parts}
    np.testing.assert_allclose(where["door"], [0.21, 0, 0.55], atol=1e-6)
    np.testing.assert_allclose(where["handle"], [0.235, 0.2, 0.55], atol=1e-6)
    np.testing.assert_allclose(where["drawer"], [0.0, 0, 0.12], atol=1e-6)
    assert {part.name: part.material for part in built.parts}["door"] == "glass"


def test_the_same_program_gives_the_same_bytes(parts):
    texts = {scenes.built(scenes.PROGRAM, parts).json() for _ in range(2)}
    assert len(texts) == 1
    content = json.loads(texts.pop())
    assert (content["schema"], content["schema_version"]) == ("articulate.program", 1)
    assert set(content["layers"]) <= {"limits", "user", "landlock", "seccomp"}
    assert "limits" in content["layers"]


@pytest.mark.parametrize(
    ("source", "line", "column", "kind"),
    [
        ("x = 1\nimport os", 2, 1, "rule"),
        ("x = (", 1, 5, "syntax"),
        ("x = 1\ny = box('bod')", 2, 5, "value"),
        ("x = [0]\nfor k in range(90):\n    x = x + x", 3, 9, "value"),
        ("def f():\n    place('door', 1)\nf()", 2, 5, "value"),
    ],
)
def test_an_error_has_line_column_and_kind(parts, source, line, column, kind):
    error = scenes.refused(source, parts)
    assert (error.line, error.column, error.kind) == (line, column, kind)
    assert str(error).startswith(f"line {line}, column {column}: ")
    assert "limits" in error.layers


def test_the_clock_stops_what_the_parent_computes(parts, monkeypatch):
    done = []

    def slow(*arguments):
        time.sleep(1.2)
        done.append(contact_along(*arguments))
        return done[-1]

    monkeypatch.setattr(api, "contact_along", slow)
    source = 'place_relative_to("drawer", "body", "above")\n'
    found = run_program(source, parts, SandboxLimits(seconds=1.0))
    assert isinstance(found, ProgramError)
    assert (found.line, found.kind, done) == (1, "limit", [])


def test_a_program_that_is_too_long_is_refused_before_a_process_starts(parts):
    error = scenes.refused("#" * 300_000, parts)
    assert error.layers == ()
    assert "200000 are accepted" in error.message


def test_the_clock_stops_a_program(parts):
    error = scenes.refused("x = 1", parts, SandboxLimits(seconds=0.001))
    assert (error.kind, "more than 0.001 s" in error.message) == ("limit", True)


FORGED = {
    "done at once": ("say({'done': True})", None),
    "private call": ("say({'call': '_join', 'arguments': {}}); hear(); say({'done': True})", None),
    "strange call": ("say({'call': {}, 'arguments': 7}); hear(); say({'done': True})", None),
    "nothing": ("pass", "ended with code 0"),
    "no JSON": ("os.write(1, b'hello\\n'); hear()", "not JSON"),
    "a list": ("os.write(1, b'[1]\\n'); hear()", "not JSON"),
    "deep JSON": ("os.write(1, b'[' * 200000 + b'\\n'); hear()", "not JSON"),
    "long line": ("[os.write(1, b'x' * 60000) for k in range(100)]", "too long"),
    "unknown message": ("say({'hello': 1})", "sent no result"),
    "crash": ("import ctypes; ctypes.string_at(0)", "crashed"),
    "forged violation": ("say({'violation': {'line': 'x', 'column': -1, 'message': [1]}})", "[1]"),
    "silence": ("import time; time.sleep(60)", "more than 2 s"),
    "kill": ("import signal; os.kill(os.getpid(), 9)", "exceeded its time or memory"),
}
HEAD = """
import json, os, sys
def say(content): os.write(1, json.dumps(content).encode() + b"\\n")
def hear(): os.read(0, 100000)
say({"layers": ["none"]})
hear()
"""


@pytest.mark.parametrize("case", FORGED)
def test_a_child_that_was_taken_over_can_only_talk(parts, tmp_path, monkeypatch, case):
    """Whatever a child says, the parent ends with data of its own or a sentence."""
    script = tmp_path / "child.py"
    body, words = FORGED[case]
    script.write_text(f"{HEAD}{body}\n")
    monkeypatch.setattr(run, "CHILD", script)
    found = run_program("x = 1", parts, SandboxLimits(seconds=2.0 if case == "silence" else 20.0))
    if words is None:
        assert isinstance(found, ProgramObject)
        assert {part.name for part in found.parts} == set(parts)
    else:
        assert isinstance(found, ProgramError)
        assert words in found.message
        assert "\n" not in found.message


def test_a_child_that_does_not_listen_is_given_up(parts, tmp_path, monkeypatch):
    """The program is longer than a pipe holds."""
    script = tmp_path / "child.py"
    script.write_text("import os, time\nos.write(1, b'{\"layers\": []}\\n')\ntime.sleep(60)\n")
    monkeypatch.setattr(run, "CHILD", script)
    error = scenes.refused("#" * 150_000, parts, SandboxLimits(seconds=2.0))
    assert (error.kind, "more than 2 s" in error.message) == ("limit", True)


def test_a_child_that_is_gone_is_told(parts, tmp_path, monkeypatch):
    script = tmp_path / "child.py"
    script.write_text("import sys\nsys.exit(7)\n")
    monkeypatch.setattr(run, "CHILD", script)
    assert "ended with code 7" in scenes.refused("x = 1", parts).message


def test_parts_that_cannot_be_read_are_told(tmp_path, error_line):
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "door.obj").write_text("hello")
    (tmp_path / "two").mkdir()
    for suffix in ("obj", "stl"):
        (tmp_path / "two" / f"door.{suffix}").write_text("")
    error_line("parts_of(Path('none'))", lambda: parts_of(tmp_path / "none"))
    error_line("parts_of(Path('empty'))", lambda: parts_of(tmp_path / "empty"))
    error_line("parts_of(Path('two'))", lambda: parts_of(tmp_path / "two"))
    error_line("parts_of({})", lambda: parts_of({}))
    error_line("parts_of({'': mesh})", lambda: parts_of({"": scenes.cabinet()}))
    error_line("parts_of({'a': Path('a.obj')})['a'].pieces",
               lambda: parts_of({"a": tmp_path / "a.obj"})["a"].pieces)  # fmt: skip
    found = scenes.refused("x = box('door')", parts_of(tmp_path / "bad"))
    assert "door.obj" in found.message
    with pytest.raises(AssetError, match="no area"):
        _ = parts_of({"a": scenes.box((0, 0, 0))})["a"].pieces


def test_a_folder_of_meshes_gives_its_files_as_parts(tmp_path):
    for name, mesh in scenes.parts().items():
        mesh.export(tmp_path / f"{name}.{'glb' if name == 'door' else 'obj'}")
    given = parts_of(tmp_path)
    assert list(given) == ["body", "door", "drawer", "handle"]
    assert scenes.built(scenes.PROGRAM, tmp_path).root == "body"
