"""A recording of the joints in motion, where rerun is installed."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from articulate.reconstruct.actors.protocol import PredictedJoint, Prediction, TraceStep
from articulate.reconstruct.query import Query
from articulate.reconstruct.rerun_export import write_recording
from articulate.render.parts import plain_part
from articulate.render.rerun_recording import rerun_name

DOOR = PredictedJoint(
    part="door", parent="body", kind="revolute", axis_o=(0.0, 0.0, 1.0), lower=0.0, upper=1.5
)


def record(query: Query):
    """What a recording reads of a story: a body, and a door that turns."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    meshes = tuple(plain_part(name, corners, faces) for name in ("body", "door"))
    trace = (TraceStep(title="guess", text="the door turns"),)
    return SimpleNamespace(
        part_set=SimpleNamespace(meshes=meshes),
        query=query,
        program="root('body')",
        prediction=Prediction(joints=(DOOR,), trace=trace),
        part_joints={"door": DOOR},
        moving=[DOOR],
    )


def test_without_rerun_there_is_no_recording(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert not write_recording(
        tmp_path / "a.rrd", record(Query(modality="text", description="a door"))
    )
    assert not any(tmp_path.iterdir())


def test_names_with_other_characters_are_parts_of_paths_without_escapes():
    assert rerun_name("Mesh door/right.002") == "Mesh_door_right.002"


def test_a_recording_holds_the_parts_the_clip_and_the_trace(tmp_path):
    pytest.importorskip("rerun")
    clip = np.zeros((3, 8, 8, 3), np.uint8)
    asked = Query(modality="video", description="a video", video=clip, times_s=np.arange(3) / 24.0)
    assert write_recording(tmp_path / "a.rrd", record(asked))
    assert [p.name for p in tmp_path.iterdir()] == ["a.rrd"]
    content = (tmp_path / "a.rrd").read_bytes()
    for entity in ("/world/body", "/world/door", "/program", "/trace/00", "/query"):
        assert entity.encode() in content
