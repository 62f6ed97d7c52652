"""Comparison of the generalist policy in two physics engines."""

import json

import generalist_physics
from generalist_scenes import SceneRecord


def test_joints_are_compared_once_and_summed(tmp_path, monkeypatch, capsys):
    records = [
        SceneRecord(object=name, source="", category="", task="open_door", joint="j",
                    placement=placement, expert=expert)
        for name, placement, expert in (("a", {}, 1.0), ("b", {}, 0.5), ("c", None, 0.0),
                                        ("d", {}, 0.1), ("e", {}, 0.9))
    ]  # fmt: skip
    scenes, out = tmp_path / "scenes.jsonl", tmp_path / "rows.jsonl"
    scenes.write_text("".join(json.dumps(vars(one)) + "\n" for one in records))
    compared: list[str] = []

    def compare(record, episodes):
        compared.append(record.object)
        row = {"object": record.object, "task": record.task, "joint": record.joint}
        if record.object == "e":
            return row | {"error": "no handle"}
        return row | {"episodes": episodes, "mujoco": 10, "pybullet": 9}

    monkeypatch.setattr(generalist_physics, "compare", compare)
    argv = ["--scenes", str(scenes), "--out", str(out), "--episodes", "10"]
    assert generalist_physics.main(argv) == 0
    assert generalist_physics.main(argv) == 0
    assert compared == ["a", "b", "e"]
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found == {"joints": 2, "errors": 1, "mujoco": 20, "pybullet": 18, "ratio": 0.9}
