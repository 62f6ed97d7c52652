"""The list of objects is in order, tells what was skipped, and goes on where it was stopped."""

import json
import sys
from typing import Any

import choose

INDEX: list[dict[str, Any]] = [
    {"id": "partnet_20", "partnet_id": "20", "source": "partnet", "category": "Box"},
    {"id": "partnet_3", "partnet_id": "3", "source": "partnet", "category": "Box"},
    {"id": "partnet_100", "partnet_id": "100", "source": "partnet", "category": "Box"},
    {"id": "partnet_1", "partnet_id": "1", "source": "partnet", "category": "Chair"},
    {"id": "a_box", "partnet_id": None, "source": "zoo", "category": "Box"},
    {"id": "b_box", "partnet_id": None, "source": "zoo", "category": "Box"},
]
GOOD = {"partnet_20", "partnet_100", "a_box", "b_box"}


def recorder(tried):
    def attempt(row, item):
        tried.append(item["id"])
        return {"id": item["id"]} | ({} if item["id"] in GOOD else {"reason": "refused"})

    return attempt


def test_the_lowest_number_that_passes_is_taken_and_those_before_it_are_told():
    row = choose.Row(task="open_lid", categories=("Box",), first=("b_box",))
    tried: list[str] = []
    *partly, last = choose.progress(row, INDEX, {}, recorder(tried))
    assert tried == ["partnet_3", "partnet_20", "b_box"]
    assert [r["id"] for r in last["taken"]] == ["partnet_20", "b_box"]
    assert [r["id"] for r in last["skipped"]] == ["partnet_3"]
    assert last["complete"]
    assert [state["complete"] for state in partly] == [False, False, False]


def test_what_is_known_is_not_tried_again():
    row = choose.Row(task="open_lid", categories=("Box",), partnet=2, others=0)
    known = {"partnet_3": {"id": "partnet_3", "reason": "refused"}}
    tried: list[str] = []
    *_, last = choose.progress(row, INDEX, known, recorder(tried))
    assert tried == ["partnet_20", "partnet_100"]
    assert last["skipped"] == [known["partnet_3"]]


def test_a_list_that_was_stopped_goes_on(tmp_path, monkeypatch):
    (tmp_path / "assets.json").write_text(json.dumps({"assets": INDEX}))
    monkeypatch.setenv("ARTICULATE_DATA", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(choose, "ROWS", (choose.Row(task="open_lid", categories=("Box",)),))
    tried: list[str] = []
    attempt = recorder(tried)
    monkeypatch.setattr(choose, "tried", lambda row, item, data, cache: attempt(row, item))
    out = tmp_path / "list.json"
    monkeypatch.setattr(sys, "argv", ["choose.py", "--out", str(out), "--minutes", "0"])
    assert choose.main() == 1
    assert choose.main() == 1
    monkeypatch.setattr(sys, "argv", ["choose.py", "--out", str(out)])
    assert choose.main() == 0
    assert tried == ["partnet_3", "partnet_20", "a_box"]
    (row,) = json.loads(out.read_text())["rows"]
    assert row["complete"]
    assert [r["id"] for r in row["taken"]] == ["partnet_20", "a_box"]
    assert choose.main() == 0
    assert len(tried) == 3
