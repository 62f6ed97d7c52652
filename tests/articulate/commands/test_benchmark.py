from __future__ import annotations

import json

import pytest
from tests.articulate.benchmark.objects import write_index

from articulate.benchmark import protocols, summary
from articulate.commands import main as articulate
from articulate.commands.benchmark import (
    PROTOCOLS,
    SCHEMA,
    SCHEMA_VERSION,
    BenchmarkFlags,
    main,
)
from articulate.errors import ConfigError


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A finished run over two objects, one of which is damaged; its exit code and its folder."""
    folder = tmp_path_factory.mktemp("bench")
    index = write_index(folder, ("a", "b"))
    (folder / "objects" / "b" / "mobility.urdf").write_text("<robot")
    out = folder / "out"
    code = main([str(index), "--modality", "text", "--out", str(out), "--jobs", "2"])
    return code, index, out


def test_a_run_leaves_results_a_report_and_a_record_for_each_object(done):
    code, _, out = done
    assert code == 3  # one object was lost
    assert sorted(p.name for p in out.iterdir()) == ["objects", "report.html", "results.json"]
    assert sorted(p.name for p in (out / "objects").iterdir()) == ["a.json", "b.json"]
    results = json.loads((out / "results.json").read_text())
    assert results["objects"] == 2
    for protocol in ("paper", "released_code", "strict"):
        row = results["protocols"][protocol]
        assert set(row) >= {"joint_success", "type_axis_origin", "n"}
        assert 0.0 <= row["joint_success"] <= row["type_axis_origin"] <= 1.0
    assert [row["object"] for row in results["crashed"]] == ["b"]


def test_json_prints_the_results_themselves_and_a_second_run_takes_what_is_there(done, capsys):
    _, index, out = done
    before = (out / "objects" / "a.json").stat().st_mtime_ns
    main([str(index), "--modality", "text", "--out", str(out), "--json"])
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "results.json").read_text())
    assert (out / "objects" / "a.json").stat().st_mtime_ns == before


def test_people_are_reported_the_protocol_they_requested(done, capsys):
    _, index, out = done
    main([str(index), "--modality", "text", "--out", str(out), "--protocol", "strict"])
    reports = capsys.readouterr().out
    assert "strict" in reports
    assert "paper" not in reports
    assert "report.html" in reports


def test_quiet_reports_nothing_but_results_and_a_folder_is_named_where_none_is_set(
    tmp_path, capsys, monkeypatch
):
    index = write_index(tmp_path, ("a",))
    monkeypatch.chdir(tmp_path)
    assert articulate(["benchmark", str(index), "--modality", "text", "-q"]) == 0
    out, err = capsys.readouterr()
    (made,) = (tmp_path / "runs").iterdir()
    assert made.name.startswith("benchmark-text-prior-")
    assert f"page: runs/{made.name}/report.html" in out
    assert err == ""
    assert f"--out runs/{made.name}" in (made / "report.html").read_text()


def test_other_runs_are_compared_in_the_report(done, error_line):
    _, index, out = done
    page = (out / "report.html").read_text()
    assert "Comparison of runs" not in page
    main([str(index), "--modality", "text", "--out", str(out), "--compare-with", str(out)])
    assert "Comparison of runs" in (out / "report.html").read_text()
    argv = [str(index), "--modality", "text", "--out", str(out), "--compare-with", "nowhere"]
    error_line("articulate benchmark assets.json --compare-with nowhere", lambda: main(argv))


def test_runs_whose_folders_are_called_alike_stand_beside_each_other(done):
    _, index, out = done
    folders = [out.parent / "first" / "run", out.parent / "second" / "run"]
    for folder in folders:
        folder.mkdir(parents=True)
        (folder / "results.json").write_bytes((out / "results.json").read_bytes())
    argv = [str(index), "--modality", "text", "--out", str(out), "--compare-with"]
    main([*argv, *map(str, folders)])
    page = (out / "report.html").read_text()
    assert all(f">{folder}</td>" in page for folder in folders)


def test_results_that_are_none_are_rejected(done, tmp_path):
    _, index, out = done
    (tmp_path / "results.json").write_text("[]")
    argv = [str(index), "--out", str(out), "--compare-with", str(tmp_path)]
    with pytest.raises(ConfigError, match=r"is not of|a JSON object was expected"):
        main(argv)


def test_what_is_written_without_a_run_is_reported_as_json(tmp_path, capsys):
    index = write_index(tmp_path, ("a",))
    out = tmp_path / "out"
    assert main([str(index), "--modality", "text", "--export", "--json", "--out", str(out)]) == 0
    assert json.loads(capsys.readouterr().out) == {"queries": 1, "folder": str(out)}


def test_a_dry_run_skips_objects_about_which_there_is_no_question(tmp_path, capsys):
    still = tmp_path / "still.urdf"
    still.write_text(
        '<robot name="r"><link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual>'
        "</link></robot>"
    )
    argv = [str(tmp_path), "--actor", "vlm", "--dry-run", "--json", "--out", str(tmp_path / "out")]
    assert main([*argv, "--width-px", "32", "--height-px", "32"]) == 0
    pages = str(tmp_path / "out" / "prompts")
    written = json.loads(capsys.readouterr().out)
    assert (written["pages"], written["requests"], written["folder"]) == (0, 0, pages)


def test_the_command_knows_protocols_and_schema_by_the_names_of_the_benchmark():
    """They are written out in the command so that --help need not read meshes."""
    assert (SCHEMA, SCHEMA_VERSION) == (summary.SCHEMA, summary.SCHEMA_VERSION)
    assert protocols.PROTOCOLS == PROTOCOLS


def test_only_what_is_named_is_run(done):
    _, index, out = done
    folder = out.parent / "only"
    assert main([str(index), "--modality", "text", "--only", "a", "--out", str(folder)]) == 0
    assert [p.name for p in (folder / "objects").iterdir()] == ["a.json"]


@pytest.mark.parametrize(
    "argv",
    [
        ["--only", "Cabinet"],
        ["--jobs", "-1"],
        ["--limit", "0"],
        ["--limit", "inf"],
        ["--limit", "1e7"],
        ["--first", "0"],
        ["--seed", "-1"],
        ["--actor", "os:getcwd"],
        ["--modality", "video", "--task", "placement"],
    ],
)
def test_what_cannot_be_run_is_rejected(done, argv, error_line):
    _, index, out = done
    error_line(
        f"articulate benchmark assets.json {' '.join(argv)}",
        lambda: main([str(index), "--out", str(out), *argv]),
    )


def test_every_flag_has_a_word_of_help():
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0


def test_the_flags_decide_the_settings(tmp_path):
    flags = BenchmarkFlags(dataset="procedural", out=tmp_path, n_frames=9, seed=4)
    assert (flags.config().n_frames, flags.config().seed) == (9, 4)
    with pytest.raises(ConfigError):
        BenchmarkFlags(dataset="procedural", out=tmp_path, n_frames=1).config()


@pytest.mark.parametrize("missing", ["config", "cost"])
def test_results_that_lack_something_are_rejected_before_the_run(done, tmp_path, missing):
    _, index, out = done
    content = json.loads((out / "results.json").read_text())
    del content[missing]
    (tmp_path / "results.json").write_text(json.dumps(content))
    argv = [str(index), "--out", str(tmp_path / "new"), "--compare-with", str(tmp_path)]
    with pytest.raises(ConfigError, match=f"has no {missing}"):
        main(argv)
    assert not (tmp_path / "new").exists()
