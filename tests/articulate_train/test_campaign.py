import json

import pytest
from tests.runs import write_checkpoint

from articulate.errors import DivergedError, RunError
from articulate_train import campaign
from articulate_train.campaign import SeedProgress, last_progress, read_progress, train_seeds
from articulate_train.seed import DIVERGED, DONE, PROGRESS


def row(steps, success=0.5, opened=0.75):
    return {"steps": steps, "seconds": steps / 100, "success": success, "opened": opened}


class FakeProcess:
    """A seed's process that has done its work when it starts."""

    def __init__(self, run, seed, code, log=""):
        folder = run.seed_folder(seed)
        folder.mkdir(exist_ok=True)
        (run.folder / f"seed_{seed}.log").write_text(log)
        (folder / PROGRESS).write_text(json.dumps(row(192)) + "\n")
        if code == 0:
            (folder / DONE).write_text(json.dumps({"steps": run.config.steps}))
        self.returncode = code
        self.terminated = False

    def poll(self):
        return self.returncode

    def terminate(self):
        self.terminated = True

    def wait(self):
        return self.returncode


@pytest.fixture
def fake(tiny, monkeypatch):
    """Lets seeds end with a code and a log; the seeds that were started."""
    started = []

    def set_up(code=0, log=""):
        def start(folder, seed, threads):
            started.append((seed, threads))
            return FakeProcess(tiny, seed, code, log)

        monkeypatch.setattr(campaign, "_start", start)
        return started

    return set_up


def test_seeds_that_are_not_done_are_trained_and_summed_up(tiny, fake):
    started = fake()
    told: list[SeedProgress] = []
    assert train_seeds(tiny, told.append)
    assert [seed for seed, _ in started] == [0]
    assert (told[0].seed, told[0].steps, told[0].total) == (0, 192, tiny.config.steps)
    assert (told[0].success, told[0].opened, told[0].steps_per_s) == (0.5, 0.75, 100.0)
    summary = json.loads((tiny.folder / "summary.json").read_text())
    assert summary["seeds"] == [{"seed": 0, **row(192)}]
    assert summary["joint"] == tiny.task.joint


def test_run_that_is_done_starts_nothing_and_keeps_its_summary(tiny, fake):
    started = fake()
    assert train_seeds(tiny, lambda _: None)
    before = (tiny.folder / "summary.json").read_bytes()
    assert train_seeds(tiny, lambda _: pytest.fail("told"))
    assert len(started) == 1
    assert (tiny.folder / "summary.json").read_bytes() == before


def test_seed_that_has_fewer_steps_than_are_asked_for_goes_on(tiny, fake):
    started = fake()
    (tiny.seed_folder(0)).mkdir()
    (tiny.seed_folder(0) / DONE).write_text('{"steps": 64}')
    assert train_seeds(tiny, lambda _: None)
    assert [seed for seed, _ in started] == [0]


def test_interrupted_seed_ends_the_run_without_an_error(tiny, fake):
    fake(code=130)
    assert not train_seeds(tiny, lambda _: None)
    assert not (tiny.folder / "summary.json").exists()


def test_seed_that_diverges_is_told_with_where_its_states_lie(tiny, fake):
    fake(code=2, log="weights are not finite after 64 steps\n")
    with pytest.raises(DivergedError, match="seed 0 diverged: weights are not finite after 64"):
        train_seeds(tiny, lambda _: None)
    with pytest.raises(DivergedError, match=f"seed_0/{DIVERGED}"):
        train_seeds(tiny, lambda _: None)


@pytest.mark.parametrize(
    ("log", "what"), [("Traceback\nKeyError: 'x'\n", "KeyError: 'x'"), ("", "exit 1")]
)
def test_seed_that_fails_is_told_with_its_last_line_and_its_log(tiny, fake, log, what):
    fake(code=1, log=log)
    with pytest.raises(RunError) as caught:
        train_seeds(tiny, lambda _: None)
    log_path = tiny.folder / "seed_0.log"
    assert str(caught.value) == f"seed 0 failed: {what}; its log is {log_path}"


def test_interrupt_stops_all_seeds_and_is_no_error(tiny, fake, monkeypatch):
    fake()
    monkeypatch.setattr(campaign, "_tell", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    assert not train_seeds(tiny, lambda _: None)


def test_progress_is_read_up_to_a_line_that_is_cut_off(tmp_path):
    assert read_progress(tmp_path) == []
    lines = [json.dumps(row(k)) for k in (10, 20)]
    (tmp_path / PROGRESS).write_text("\n".join([*lines, '{"steps": 3']))
    assert read_progress(tmp_path) == [row(10), row(20)]


def test_seed_without_progress_has_its_number_alone(tiny):
    write_checkpoint(tiny.seed_folder(0), 0)
    assert last_progress(tiny, 0) == {"seed": 0}


def test_progress_that_is_written_anew_meanwhile_is_not_told(tiny):
    """A seed that is resumed drops the lines after its checkpoint."""
    tiny.seed_folder(0).mkdir()
    (tiny.seed_folder(0) / PROGRESS).write_text("")
    seen = {0: 5}
    campaign._tell(tiny, 0, seen, lambda _: pytest.fail("told"))
    assert seen == {0: 5}
