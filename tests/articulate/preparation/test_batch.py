import os
import sys
from xml.dom import minidom

import pytest

from articulate.assets.check_report import CheckReport
from articulate.errors import UsageError
from articulate.preparation import batch, store
from articulate.preparation.batch import Batch, Checked, Item, items_in, write_junit
from articulate.preparation.check_report_file import save_check_report

LIMIT_S = 2.0


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("<robot/>")


def test_a_file_and_a_folder_with_one_urdf_are_one_object(tmp_path):
    touch(tmp_path / "one", "a.urdf", "scene.xml", "meshes/a.obj")
    urdf = tmp_path / "one" / "a.urdf"
    assert items_in(urdf) == ([Item(name="a", file=urdf)], True)
    assert items_in(tmp_path / "one") == ([Item(name="one", file=urdf)], True)


def test_a_folder_with_one_mjcf_file_is_one_object(tmp_path):
    touch(tmp_path / "one", "a.xml", "package.xml")
    assert items_in(tmp_path / "one")[0] == [Item(name="one", file=tmp_path / "one" / "a.xml")]


def test_any_other_folder_is_a_folder_of_objects(tmp_path):
    touch(tmp_path, "a/x.urdf", "b/c/y.xml", "d/1.urdf", "d/2.urdf", "e/asset.json", "e/object.xml")
    touch(tmp_path, ".hidden/z.urdf", "f/readme.txt")
    items, single = items_in(tmp_path)
    assert not single
    assert [(i.name, i.file.relative_to(tmp_path).as_posix()) for i in items] == [
        ("a", "a/x.urdf"),
        ("b/c", "b/c/y.xml"),
        ("d/1", "d/1.urdf"),
        ("d/2", "d/2.urdf"),
        ("e", "e"),
    ]


def test_results_of_a_folder_are_none_of_its_objects(tmp_path):
    touch(tmp_path, "a.urdf", "b.urdf", "checked/all/a/asset.json", "checked/all/b/asset.json")
    out = tmp_path / "checked" / "all"
    assert [i.name for i in items_in(tmp_path, out)[0]] == ["a", "b"]
    assert [i.name for i in items_in(out, out)[0]] == ["a", "b"]  # it was asked for
    touch(tmp_path, "one/asset.json")
    assert [i.name for i in items_in(tmp_path, out)[0]] == ["a", "b", "one"]


def test_names_in_a_batch_are_unique(tmp_path):
    touch(tmp_path, "a.urdf", "b.urdf", "a/x.urdf")
    assert sorted(i.name for i in items_in(tmp_path)[0]) == ["a", "a_", "b"]


def test_a_file_beside_a_folder_of_its_name_has_a_result_of_its_own(tmp_path):
    touch(tmp_path, "b.urdf", "cab.urdf", "cab/x.urdf", "cab/y.urdf", "cab_/v.urdf", "cab_/w.urdf")
    names = sorted(i.name for i in items_in(tmp_path)[0])
    assert names == ["b", "cab/x", "cab/y", "cab_/v", "cab_/w", "cab__"]


def test_a_path_with_too_long_a_name_is_refused_in_one_line(tmp_path):
    with pytest.raises(UsageError, match="cannot be looked up"):
        items_in(tmp_path / ("x" * 300))


def test_nothing_to_check_is_wrong_usage(tmp_path):
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "empty", tmp_path / "none"):
        with pytest.raises(UsageError):
            items_in(path)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UsageError, match="neither a file nor a folder"):
        items_in(tmp_path / "pipe")


@pytest.fixture
def run_script(tmp_path, monkeypatch):
    """``run_script(script, *names)``: reports of objects whose children run ``script``.

    It sees ``request``, and calls ``give(verdict, *reasons)`` to write a report.
    """
    head = """
import json, os, signal, sys, time
from pathlib import Path
from articulate.assets.check_report import CheckReport
from articulate.preparation.check_report_file import save_check_report
request = json.loads(sys.stdin.read())
def give(verdict, *reasons):
    folder = Path(request["cache"]) / "assets" / Path(request["file"]).stem
    folder.mkdir(parents=True, exist_ok=True)
    save_check_report(CheckReport(asset=folder.name, verdict=verdict, reasons=reasons), folder)
    print(f"\\n{folder}")
    sys.exit(0)
"""
    python = sys.executable

    def run(script, *names, jobs=1, limit_s=60.0):
        child = tmp_path / "child"
        child.write_text(f"#!{python}\n{head}{script}\n")
        child.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(child))
        touch(tmp_path / "in", *(f"{name}.urdf" for name in names))
        items = [Item(name=name, file=tmp_path / "in" / f"{name}.urdf") for name in names]
        batch = Batch(
            out=tmp_path / "out",
            cache=tmp_path / "cache",
            options={},
            limit_s=limit_s,
            single=False,
        )
        found = {r.item.name: r.check_report for r in batch.run(items, jobs)}
        records = list((tmp_path / "cache" / "checks").glob("*.json"))
        return found, len(records)

    return run


def test_one_that_crashes_is_rejected_and_the_others_are_not(run_script):
    script = 'if "bad" in request["file"]: os.kill(os.getpid(), signal.SIGSEGV)\ngive("passed")'
    found, records = run_script(script, "good", "bad", "fine", jobs=2)
    assert {name: p.verdict for name, p in found.items()} == {
        "good": "passed",
        "bad": "rejected",
        "fine": "passed",
    }
    assert "a library crashed on it (SIGSEGV)" in found["bad"].reasons[0]
    assert records == 1  # it would crash again


def test_the_time_limit_leaves_an_object_undecided_and_names_the_time_it_took(run_script):
    found, records = run_script("while True: pass", "slow", limit_s=LIMIT_S)
    assert found["slow"].verdict == "undecided"
    assert "more than the limit of 2 s; give it more with --limit" in found["slow"].reasons[0]
    assert LIMIT_S < found["slow"].seconds < 3 * LIMIT_S
    assert records == 0  # it may be faster another time


@pytest.mark.parametrize(
    ("script", "verdict", "reason"),
    [
        (
            "raise ValueError('a bug')",
            "undecided",
            "its process ended with 1: ValueError: a bug",
        ),
        ("print('words')", "undecided", "left no check report"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "undecided", "was there enough memory?"),
    ],
)
def test_however_a_child_ends_there_is_a_verdict(run_script, script, verdict, reason):
    found, _ = run_script(script, "odd")
    assert found["odd"].verdict == verdict
    assert reason in found["odd"].reasons[0]


def test_bad_usage_in_a_child_stops_the_batch(run_script):
    with pytest.raises(UsageError, match="size is -1"):
        run_script("sys.stderr.write('size is -1'); sys.exit(2)", "a", "b")


def test_names_with_folders_lie_in_folders(tmp_path, monkeypatch):
    folder = tmp_path / "cache" / "a"
    folder.mkdir(parents=True)
    save_check_report(CheckReport(asset="a", verdict="passed"), folder)
    monkeypatch.setattr(store, "load", lambda *_: folder)
    run = Batch(out=tmp_path / "out", cache=tmp_path, options={}, limit_s=1.0, single=False)
    result = run.one(Item(name="x/y", file=tmp_path / "a.urdf"))
    assert result.folder == tmp_path / "out" / "x" / "y"
    assert result.check_report.verdict == "passed"


def test_junit_has_a_case_for_each_object_and_a_failure_for_each_refused(tmp_path):
    check_reports = {
        "a/b": CheckReport(asset="b", verdict="passed", seconds=1.5),
        "c": CheckReport(
            asset="c", verdict="rejected", reasons=('a "quoted" <reason>', "bell \x07")
        ),
    }
    results = [
        Checked(item=Item(name=name, file=tmp_path), check_report=check_report, folder=tmp_path)
        for name, check_report in check_reports.items()
    ]
    write_junit(results, tmp_path / "report.xml")
    suite = minidom.parse(str(tmp_path / "report.xml")).getElementsByTagName("testsuite")[0]
    assert (suite.getAttribute("tests"), suite.getAttribute("failures")) == ("2", "1")
    cases = suite.getElementsByTagName("testcase")
    assert [case.getAttribute("name") for case in cases] == ["a/b", "c"]
    (failure,) = suite.getElementsByTagName("failure")
    assert failure.getAttribute("message") == 'a "quoted" <reason>\nbell '


def test_a_result_that_was_damaged_since_is_handed_over_again(tmp_path):
    made, out = tmp_path / "made", tmp_path / "out"
    for folder in (made, out):
        (folder / "meshes").mkdir(parents=True)
        (folder / "check_report.json").write_text("{}")
        (folder / "meshes" / "a.obj").write_text("v 0 0 0")
    assert batch._is_same(made, out)
    (out / "meshes" / "a.obj").write_text("v 0 0 9")
    assert not batch._is_same(made, out)
    (out / "meshes" / "a.obj").unlink()
    assert not batch._is_same(made, out)
