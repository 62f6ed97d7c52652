"""Objects in processes of their own. What crashes there is a module written for it."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from tests.articulate.benchmark.objects import write_index

from articulate.benchmark.batch import BenchmarkBatch, fingerprint
from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.dataset import open_dataset
from articulate.errors import UsageError
from articulate.reconstruct.actors.semantic.embeddings import embeddings_installed

CRASHING = '''
import os, pathlib
from articulate.reconstruct.actors.protocol import Prediction

class Crashes:
    """It dies of the second object it sees."""
    name = "crashes"

    def predict(self, evidence):
        seen = pathlib.Path(os.environ["SEEN"])
        n = len(list(seen.iterdir()))
        (seen / str(n)).touch()
        if n == 1:
            os.abort()
        return Prediction(joints=())
'''


BUSY = '''
import os
from articulate.reconstruct.actors.protocol import Prediction
from articulate.errors import UsageError

class Asks:
    """Its server is busy for a while."""
    name = "asks"

    def predict(self, evidence):
        if os.environ.get("BUSY"):
            raise UsageError("the server answers 429")
        return Prediction(joints=())
'''


def batch(tmp_path, names, **changes) -> BenchmarkBatch:
    path = write_index(tmp_path, names)
    given = {
        "config": BenchmarkConfig(actor="prior", modality="text"),
        "limit_s": 120.0,
        **changes,
    }
    return BenchmarkBatch(
        dataset=open_dataset(str(path)),
        source=str(path),
        data=None,
        out=tmp_path / "out",
        **given,
    )


def test_a_crash_costs_one_object(tmp_path, monkeypatch):
    (tmp_path / "crashing.py").write_text(CRASHING)
    (tmp_path / "seen").mkdir()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("SEEN", str(tmp_path / "seen"))
    config = BenchmarkConfig(actor="crashing:Crashes", modality="text")
    run = batch(tmp_path, ("a", "b"), config=config)
    one, two = list(run.run(["a", "b"], 1))
    assert one["error"] == ""
    assert "SIGABRT" in two["error"]
    assert [j["joint"] for j in two["cases"][0]["joints"]] == [f"link_{i}" for i in (1, 2, 3, 4)]
    assert {j["failures"]["strict"] for j in two["cases"][0]["joints"]} == {"joint_type"}


def test_an_object_that_takes_too_long_is_lost(tmp_path):
    run = batch(tmp_path, ("a",), limit_s=0.2)
    assert "more than the limit of 0.2 s" in run.one("a")["error"]


def test_a_run_goes_on_where_it_was_unless_the_settings_changed(tmp_path):
    run = batch(tmp_path, ("a",))
    first = run.one("a")
    path = run.path_of("a")
    marked = json.loads(path.read_text()) | {"marked": True}
    path.write_text(json.dumps(marked))
    assert run.one("a").get("marked")
    path.write_text(path.read_text()[:100])
    again = run.one("a")
    assert not again.get("marked")
    assert again["cases"][0]["joints"] == first["cases"][0]["joints"]
    other = batch(tmp_path / "other", ("a",), config=replace(run.config, seed=1))
    assert other.fingerprint != run.fingerprint


def test_what_a_busy_server_cost_is_asked_again(tmp_path, monkeypatch):
    (tmp_path / "busy.py").write_text(BUSY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("BUSY", "1")
    run = batch(tmp_path, ("a",), config=BenchmarkConfig(actor="busy:Asks", modality="text"))
    assert "429" in run.one("a")["cases"][0]["rejection"]
    monkeypatch.delenv("BUSY")
    assert run.one("a")["cases"][0]["rejection"] == ""


def test_what_was_lost_to_an_error_is_run_again(tmp_path):
    run = batch(tmp_path, ("a",), limit_s=0.1)
    assert run.one("a")["error"]
    patient = BenchmarkBatch(
        dataset=run.dataset,
        source=run.source,
        data=None,
        config=run.config,
        out=run.out,
        limit_s=120.0,
    )
    assert patient.one("a")["error"] == ""


def test_index_data_and_model_decide_what_is_made_anew(tmp_path, monkeypatch):
    monkeypatch.delenv("ARTICULATE_MODEL", raising=False)
    config = BenchmarkConfig(actor="prior")
    path = write_index(tmp_path)
    source = str(path)
    first = fingerprint(source, None, config)
    assert fingerprint(source, tmp_path, config) == first
    monkeypatch.chdir(tmp_path)
    assert fingerprint(path.name, None, config) == first
    other = fingerprint(source, tmp_path / "elsewhere", config)
    monkeypatch.setenv("ARTICULATE_MODEL", "another")
    asked = fingerprint(source, None, config)
    monkeypatch.delenv("ARTICULATE_MODEL")
    path.write_text(path.read_text().replace("0.5", "0.6"))
    assert len({first, other, asked, fingerprint(source, None, config)}) == 4
    library = fingerprint("procedural", None, config)
    assert fingerprint(str(tmp_path), None, config) != library
    folder = fingerprint(str(tmp_path), None, config)
    (tmp_path / "part.obj").write_text("v 0 0 0\n")
    assert fingerprint(str(tmp_path), None, config) != folder
    was = embeddings_installed()
    monkeypatch.setattr("articulate.benchmark.batch.embeddings_installed", lambda: not was)
    assert fingerprint("procedural", None, config) != library


def test_an_object_that_cannot_be_read_is_lost_with_its_joints(tmp_path):
    run = batch(tmp_path, ("a",))
    (tmp_path / "objects" / "a" / "mobility.urdf").write_text("<robot")
    record = run.one("a")
    assert "mobility.urdf" in record["error"]
    assert len(record["cases"][0]["joints"]) == 4


def test_an_actor_that_does_not_exist_ends_the_run(tmp_path):
    run = batch(tmp_path, ("a",), config=BenchmarkConfig(actor="priar", modality="text"))
    with pytest.raises(UsageError, match="did you mean prior"):
        run.one("a")


@pytest.mark.parametrize("object_id", ["../../escape", ".hidden", "a/b", "a b"])
def test_a_record_stays_in_its_folder_whatever_the_id(tmp_path, object_id):
    run = batch(tmp_path, ("a",))
    path = run.path_of(object_id).resolve()
    assert path.parent == (tmp_path / "out" / "objects").resolve()
    assert not path.name.startswith(".")
    assert path != run.path_of(object_id + "_")
