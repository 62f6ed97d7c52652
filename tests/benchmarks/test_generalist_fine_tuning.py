"""The table of fine-tuned objects is resumable."""

import json
from pathlib import Path

import generalist_fine_tuning
from articulate_train.generalist import generalist_metadata
from generalist_scenes import SceneRecord


def test_what_the_table_holds_is_not_trained_again(tmp_path, monkeypatch):
    records = [
        SceneRecord(object=name, source="a.urdf", category="", task="open_door", joint="hinge",
                    placement=placement, expert=1.0)
        for name, placement in (("first", {}), ("second", {}), ("rejected", None))
    ]  # fmt: skip
    scenes, out = tmp_path / "scenes.jsonl", tmp_path / "rows.jsonl"
    scenes.write_text("".join(json.dumps(vars(one)) + "\n" for one in records))
    trained: list[str] = []

    def fine_tune(record, args):
        trained.append(record.object)
        policy = generalist_metadata("open_drawer")["sha256"][:12]
        row = {"object": record.object, "task": record.task, "joint": record.joint}
        row["target_success"] = args.target_success
        return row | {"start": args.start, "seed": args.seed, "policy": policy}

    monkeypatch.setattr(generalist_fine_tuning, "fine_tune", fine_tune)
    argv = ["--scenes", str(scenes), "--out", str(out)]
    assert generalist_fine_tuning.main([*argv, "--objects", "first"]) == 0
    assert generalist_fine_tuning.main(argv) == 0
    assert generalist_fine_tuning.main([*argv, "--seed", "1"]) == 0
    assert generalist_fine_tuning.main([*argv, "--target-success", "0.99"]) == 0
    assert trained == 3 * ["first", "second"]
    assert len(Path(out).read_text().splitlines()) == 6
