from __future__ import annotations

import json

import pytest
from tests.articulate.benchmark.objects import write_index

from articulate.benchmark import ablation, ablation_rows
from articulate.benchmark.ablation_rows import ROWS, AblationRow, rows_of
from articulate.commands.benchmark import main
from articulate.reconstruct.actors.vlm.answer_store import open_recording
from articulate.reconstruct.actors.vlm.gemini import DEFAULT_MODEL

TEXT = (
    AblationRow(label="joints, text", actor="geometric-text", modality="text"),
    AblationRow(label="prior", actor="prior", modality="text"),
    AblationRow(label="joints, model", actor="vlm", modality="text", model="some-model"),
)


@pytest.fixture
def text_rows(monkeypatch):
    """Tables whose rows need no image."""
    monkeypatch.setattr(ablation_rows, "ROWS", dict.fromkeys(ROWS, TEXT))


def test_an_ablation_fills_offline_rows_and_names_missing_recordings(tmp_path, capsys, text_rows):
    index = write_index(tmp_path, ("a",))
    out = tmp_path / "out"
    argv = [str(index), "--ablation", "modality", "critic", "--out", str(out), "--json"]
    assert main(argv) == 0
    results = json.loads(capsys.readouterr().out)
    assert results == json.loads((out / "ablations.json").read_text())
    assert [table["ablation"] for table in results["ablations"]] == ["modality", "critic"]
    rows = results["ablations"][0]["rows"]
    assert [row["status"] for row in rows] == ["measured", "measured", ablation.NO_RECORDING]
    assert rows[0]["results"]["protocols"]["paper"]["n"] == 4
    assert rows[2]["results"] is None
    page = (out / "report.html").read_text()
    assert "Success by modality" in page
    assert "Critic against truth" in page
    assert "no recording" in page


@pytest.mark.slow
def test_a_second_call_continues_and_prints_the_same(tmp_path, capsys, text_rows):
    index = write_index(tmp_path, ("a",))
    argv = [str(index), "--ablation", "modality", "--out", str(tmp_path / "out"), "--json"]
    main(argv)
    first = capsys.readouterr().out
    record = tmp_path / "out" / "joints-text-prior" / "objects" / "a.json"
    before = record.stat().st_mtime_ns
    main(argv)
    assert capsys.readouterr().out == first
    assert record.stat().st_mtime_ns == before


def test_every_row_names_a_folder_that_only_equal_runs_share():
    rows = {row.folder: (row.actor, row.modality, row.task) for of in ROWS.values() for row in of}
    for of in ROWS.values():
        for row in of:
            assert rows[row.folder] == (row.actor, row.modality, row.task)


@pytest.mark.parametrize(
    "argv", [["--ablation", "modalities"], ["--ablation", "critic", "--actor", "vlm"]]
)
def test_ablations_that_cannot_be_run_are_rejected(tmp_path, argv, error_line):
    index = write_index(tmp_path, ("a",))
    error_line(
        f"articulate benchmark assets.json {' '.join(argv)}",
        lambda: main([str(index), "--out", str(tmp_path / "out"), *argv]),
    )


@pytest.mark.slow
def test_a_row_with_a_model_replays_the_recording_in_its_folder(
    tmp_path, capsys, text_rows, monkeypatch
):
    for variable in ("GOOGLE_API_KEY", "GEMINI_API_KEY"):
        monkeypatch.delenv(variable, raising=False)
    index = write_index(tmp_path, ("a",))
    recording = tmp_path / "recordings" / TEXT[2].folder
    open_recording(recording, "gemini:some-model", "gemini:some-model")
    argv = [str(index), "--ablation", "modality", "--out", str(tmp_path / "out"), "--json"]
    main([*argv, "--record", str(recording.parent)])
    row = json.loads(capsys.readouterr().out)["ablations"][0]["rows"][2]
    assert row["status"] == ablation.INCOMPLETE  # nothing was recorded, and there is no key


def test_each_recorded_model_is_a_base_model():
    recorded = ["joints-video-vlm-some-model", "joints-video-vlm-a-examples-5", "joints-text-vlm-b"]
    labels = [row.label for row in rows_of("base_model", recorded)]
    assert labels == ["no model", DEFAULT_MODEL, "some-model"]
    assert rows_of("modality", recorded) == list(ROWS["modality"])
