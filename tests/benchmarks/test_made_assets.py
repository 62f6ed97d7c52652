"""Of objects whose joints are all right, those count whose own URDF is proven."""

from pathlib import Path

import pytest

import made_assets as made
from articulate.errors import UsageError

JOINT = {
    "part": "door",
    "parent": "body",
    "kind": "revolute",
    "axis_o": [0.0, 0.0, 1.0],
    "pivot_o": [0.1, 0.2, 0.0],
    "lower": 0.0,
    "upper": 1.5,
    "confidence": 0.8,
}


def record(*failures, spurious=0, error=""):
    """One case for each joint, whose outcome under ``paper`` is given."""
    return {
        "error": error,
        "cases": [
            {
                "spurious": spurious,
                "joints": [{"failures": {"paper": f, "strict": "joint_axis"}, "predicted": JOINT}],
            }
            for f in failures
        ],
    }


def test_joints_of_all_cases_are_taken_as_they_were_said():
    joints = made.found_joints(record("success", "success"), "paper")
    assert len(joints) == 2
    assert joints[0].part == "door"
    assert joints[0].pivot_o == (0.1, 0.2, 0.0)
    assert (joints[0].lower, joints[0].upper) == (0.0, 1.5)


def test_what_goes_along_is_said_as_well():
    one = record("success")
    one["cases"][0]["fixed"] = [["handle", "door"]]
    _, handle = made.found_joints(one, "paper")
    assert (handle.part, handle.parent, handle.kind) == ("handle", "door", "fixed")


@pytest.mark.parametrize(
    "one",
    [
        record("success", "joint_axis"),
        record("success", spurious=1),
        record("success", error="lost"),
        record(),
    ],
)
def test_object_with_anything_wrong_does_not_count(one):
    assert made.found_joints(one, "paper") == []


def test_protocol_decides_what_is_right():
    assert made.found_joints(record("success"), "strict") == []


def test_share_is_of_those_whose_own_is_proven():
    pairs = [
        made.Pair("a", "proven", "repaired", ()),
        made.Pair("b", "refused", "refused", ("no",)),
        made.Pair("c", "repaired", "refused", ("it sticks",)),
        made.Pair("d", "refused", "proven", ()),
    ]
    told = made.summary(pairs, "paper")
    assert (told["objects_right"], told["own_proven"], told["made_proven"]) == (4, 2, 1)
    assert told["share"] == 0.5
    assert [p["id"] for p in told["not_proven"]] == ["c"]
    assert made.summary([], "paper")["share"] is None


def settled(monkeypatch, told, verdict, stated="proven"):
    """The pair of an object of which a summary says ``told``, and what was asked besides."""
    asked = []

    class Own:
        verdict = "repaired"

    def proof_of(urdf, out):
        asked.append(out.name)
        return Own

    def stated_of(place):
        asked.append("stated")
        return stated

    monkeypatch.setattr(made, "made_of", lambda *_: (verdict, ()))
    monkeypatch.setattr(made, "proof_of", proof_of)
    monkeypatch.setattr(made, "stated_of", stated_of)
    place = made.ObjectPlacement("a", Path("data"), Path("objects/a"), Path("out"))
    return made.pair(place, [], told), asked


@pytest.mark.parametrize(
    ("told", "verdict", "own", "asked"),
    [
        ("not refused", "proven", "not refused", []),
        ("not refused", "refused", "repaired", ["own", "stated"]),
        ("refused", "refused", "refused", []),
        ("", "proven", "repaired", ["own"]),
    ],
)
def test_own_is_proven_where_no_summary_settles_it(monkeypatch, told, verdict, own, asked):
    pair, done = settled(monkeypatch, told, verdict)
    assert (pair.own, pair.made, done) == (own, verdict, asked)


def test_what_is_refused_as_the_data_set_states_it_is_told_apart(monkeypatch):
    pair, _ = settled(monkeypatch, "", "refused", stated="refused")
    told = made.summary([pair], "paper")
    assert (told["own_proven"], told["made_proven"], told["refused_as_stated"]) == (1, 0, 1)


def test_summary_of_the_own_tells_who_is_refused(tmp_path):
    file = tmp_path / "assets.json"
    file.write_text('{"asked": 2, "objects": 2, "refused": [{"id": "b"}]}')
    assert made.own_verdicts(file, ["a", "b"]) == {"a": "not refused", "b": "refused"}
    assert made.own_verdicts(None, ["a"]) == {}
    file.write_text('{"asked": 3, "objects": 2, "refused": []}')
    with pytest.raises(UsageError, match="not all objects"):
        made.own_verdicts(file, ["a"])
