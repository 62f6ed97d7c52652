"""Jobs are command lines and folders: they run, fail, are lost, adopted and stopped."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from articulate.errors import RunError, UsageError
from articulate.files import write_json
from articulate.jobs import process_identity
from articulate.jobs.job import (
    LEASE,
    LOG,
    STATE,
    Attempt,
    Job,
    State,
    is_leased,
    load_job,
    load_state,
    save_job,
    save_state,
    take_lease,
)
from articulate.jobs.launcher import MAX_LOSSES, Progress, make_launcher, run_jobs
from articulate.jobs.local import LocalLauncher
from articulate.jobs.process_identity import this_process
from articulate.jobs.worker import LEASED, phase_of, run_job

MAKE = "import pathlib, sys; p = pathlib.Path(sys.argv[1]); p.mkdir(); (p / 'x').write_text('a')"


def python(code: str, *arguments: str | Path) -> tuple[str, ...]:
    return (sys.executable, "-c", code, *map(str, arguments))


def job_of(folder: Path, start: str = MAKE, resume: str = "", **options) -> Job:
    made = folder / "run"
    return Job(
        folder=folder,
        start_command=python(start, made),
        resume_command=python(resume, made),
        **options,
    )


def run_all(jobs, slots=2):
    seen: list[Progress] = []
    return run_jobs(jobs, LocalLauncher(slots, jobs[0].folder.parent), seen.append), seen


def test_jobs_run_and_their_folders_say_so(tmp_path):
    jobs = [job_of(tmp_path / name) for name in "abc"]
    progress, seen = run_all(jobs)
    assert progress.count("done") == 3
    assert seen[-1].count("done") == 3
    for job in jobs:
        assert (job.run_folder / "x").read_text() == "a"
        (attempt,) = load_state(job.folder).attempts
        assert (attempt.code, attempt.host) == (0, socket.gethostname())
        assert attempt.ended is not None
        assert attempt.ended >= attempt.begun
        assert not (job.folder / LEASE).exists()
        assert load_job(job.folder) == job


def test_done_jobs_are_not_run_again(tmp_path):
    job = job_of(tmp_path / "a")
    run_all([job])
    run_all([job])
    assert len(load_state(job.folder).attempts) == 1


def test_a_failed_job_costs_only_itself_and_is_tried_again_by_the_next_call_alone(tmp_path):
    bad = job_of(tmp_path / "bad", "print('it is broken'); raise SystemExit(2)")
    good = job_of(tmp_path / "good")
    progress, _ = run_all([bad, good], slots=1)
    assert progress.count("failed") == progress.count("done") == 1
    assert progress.states["bad"].message == "it is broken"
    assert len(progress.states["bad"].attempts) == 1
    progress, _ = run_all([bad, good], slots=1)
    assert len(progress.states["bad"].attempts) == 2


def test_a_job_killed_from_outside_is_taken_up_again_where_it_stands(tmp_path):
    kill = "import os, pathlib, sys; pathlib.Path(sys.argv[1]).mkdir(); os.kill(os.getpid(), 9)"
    goes_on = "import pathlib, sys; (pathlib.Path(sys.argv[1]) / 'y').write_text('went on')"
    job = job_of(tmp_path / "a", kill, goes_on)
    progress, _ = run_all([job])
    assert progress.count("done") == 1
    assert [a.code for a in progress.states["a"].attempts] == [-9, 0]
    assert (job.run_folder / "y").read_text() == "went on"


def test_a_job_that_is_lost_again_and_again_is_given_up(tmp_path):
    job = job_of(tmp_path / "a", "import os; os.kill(os.getpid(), 9)")
    progress, _ = run_all([job])
    assert progress.count("lost") == 1
    assert len(progress.states["a"].attempts) == MAX_LOSSES + 1


def test_a_worker_that_is_killed_takes_its_command_along_and_the_job_goes_on(tmp_path):
    wait = "import pathlib, sys, time; pathlib.Path(sys.argv[1]).mkdir(); time.sleep(60)"
    job = save_job(job_of(tmp_path / "a", wait, "print('went on')"))
    worker = subprocess.Popen(
        [sys.executable, "-m", "articulate.jobs.worker", str(job.folder)], start_new_session=True
    )
    until(job.run_folder.exists)
    assert load_state(job.folder).phase == "running"
    worker.kill()
    worker.wait()
    assert load_state(job.folder).phase == "lost"
    assert "disappeared" in load_state(job.folder).message
    until(lambda: not command_runs(job))
    progress, _ = run_all([job])
    assert progress.count("done") == 1
    assert progress.states["a"].message == "went on"


def test_a_worker_that_is_told_to_stop_lets_its_command_keep_what_it_has(tmp_path):
    keep = (
        "import pathlib, sys, time\n"
        "p = pathlib.Path(sys.argv[1]); p.mkdir()\n"
        "try:\n    time.sleep(60)\n"
        "except KeyboardInterrupt:\n    (p / 'kept').touch(); sys.exit(130)\n"
    )
    job = save_job(job_of(tmp_path / "a", keep))
    worker = subprocess.Popen([sys.executable, "-m", "articulate.jobs.worker", str(job.folder)])
    until(job.run_folder.exists)
    time.sleep(0.2)  # into its sleep
    worker.terminate()
    assert worker.wait() == 130
    assert (job.run_folder / "kept").exists()
    assert load_state(job.folder).phase == "waiting"


def test_one_job_has_one_worker(tmp_path):
    wait = "import pathlib, sys, time; pathlib.Path(sys.argv[1]).mkdir(); time.sleep(60)"
    job = save_job(job_of(tmp_path / "a", wait))
    worker = subprocess.Popen([sys.executable, "-m", "articulate.jobs.worker", str(job.folder)])
    until(job.run_folder.exists)
    assert run_job(job.folder) == LEASED
    worker.terminate()
    worker.wait()


def test_of_many_takers_one_gets_the_lease_an_old_one_included(tmp_path):
    lease = tmp_path / LEASE
    for old in (
        None,
        {"host": "elsewhere", "pid": 1},
        {"host": socket.gethostname(), "pid": 2**22 + 9},
    ):
        lease.unlink(missing_ok=True)
        if old is not None:
            lease.write_text(json.dumps(old))
            os.utime(lease, (time.time() - 1e4,) * 2)
            assert not is_leased(tmp_path)
        with ThreadPoolExecutor(8) as pool:
            assert sum(pool.map(take_lease, [tmp_path] * 8)) == 1
        assert is_leased(tmp_path)


def test_a_lease_of_another_machine_is_old_by_its_age(tmp_path):
    (tmp_path / LEASE).write_text('{"host": "elsewhere", "pid": 1}')
    assert is_leased(tmp_path)
    os.utime(tmp_path / LEASE, (time.time() - 61,) * 2)
    assert not is_leased(tmp_path)


def test_a_lease_whose_number_another_process_has_now_is_over(tmp_path):
    """A container that is restarted gives the same small numbers again."""
    held = {
        **this_process(),
        "pid": os.getppid(),
        "start": process_identity.start_time(os.getppid()),
    }
    write_json(tmp_path / LEASE, held)
    assert is_leased(tmp_path)
    write_json(tmp_path / LEASE, held | {"start": held["start"] - 1})
    assert not is_leased(tmp_path)
    assert take_lease(tmp_path)
    assert json.loads((tmp_path / LEASE).read_text()) == this_process()


def test_a_lease_from_before_the_machine_was_restarted_is_old_by_its_age(tmp_path):
    """Another machine may have the same name: its process is not looked for here."""
    write_json(tmp_path / LEASE, this_process() | {"boot": "another"})
    assert is_leased(tmp_path)
    os.utime(tmp_path / LEASE, (time.time() - 61,) * 2)
    assert not is_leased(tmp_path)


def test_a_lease_that_tells_the_number_alone_is_believed_while_that_lives(tmp_path):
    write_json(tmp_path / LEASE, {"host": socket.gethostname(), "pid": os.getppid()})
    assert is_leased(tmp_path)


def test_where_nothing_tells_of_processes_their_numbers_decide(tmp_path, monkeypatch):
    monkeypatch.setattr(process_identity, "BOOT", tmp_path / "none")
    monkeypatch.setattr(process_identity, "start_time", lambda _: None)
    assert take_lease(tmp_path)
    assert json.loads((tmp_path / LEASE).read_text())["start"] is None
    assert is_leased(tmp_path)


def test_the_start_of_a_process_is_read_whatever_its_name(tmp_path):
    program = tmp_path / "a) b (c"
    program.symlink_to(shutil.which("sleep"))
    child = subprocess.Popen([program, "60"])
    try:
        start, own = (
            process_identity.start_time(child.pid),
            process_identity.start_time(os.getpid()),
        )
        assert start is not None
        assert own is not None
        assert start >= own
    finally:
        child.kill()
        child.wait()
    assert process_identity.start_time(child.pid) is None


def test_another_launcher_adopts_what_one_left(tmp_path):
    job = save_job(job_of(tmp_path / "a", resume="print('adopted')"))
    job.run_folder.mkdir()
    left = State(phase="running", attempts=(Attempt(host="elsewhere", pid=1, begun=1.0),))
    save_state(job.folder, left)
    assert load_state(job.folder).phase == "lost"
    progress, _ = run_all([job])
    assert progress.states["a"].message == "adopted"


def test_a_folder_of_another_job_is_refused(tmp_path, error_line):
    job = save_job(job_of(tmp_path / "a"))
    other = dataclasses.replace(job, start_command=("true",))
    error_line("save_job(job)  # its folder holds another", lambda: save_job(other))
    (tmp_path / "a" / "job.json").write_text("{")
    with pytest.raises(RunError, match="cannot be read"):
        load_job(job.folder)


def test_a_link_in_the_folder_of_a_job_is_not_followed(tmp_path):
    job = save_job(job_of(tmp_path / "job"))
    (tmp_path / "mine").write_text("mine")
    (job.folder / "log.txt").symlink_to(tmp_path / "mine")
    with pytest.raises(UsageError, match="a link; remove it"):
        run_job(job.folder)
    assert (tmp_path / "mine").read_text() == "mine"


def test_exit_statuses_have_meanings():
    job = Job(folder=Path("x"), start_command=("a",), resume_command=("a",), accepted_codes=(0, 3))
    phases = {code: phase_of(job, code) for code in (0, 3, 1, 2, 128, 130)}
    assert phases == dict.fromkeys((0, 3), "done") | dict.fromkeys((1, 2, 128), "failed") | {
        130: "waiting"
    }


@pytest.mark.parametrize("code", [-9, -15, 137, 143])
def test_a_job_that_a_signal_ended_is_lost_told_by_a_shell_too(code):
    job = Job(folder=Path("x"), start_command=("a",), resume_command=("a",))
    assert phase_of(job, code) == "lost"


def test_a_job_whose_command_tells_of_a_kill_is_taken_up_again(tmp_path):
    job = job_of(tmp_path / "a", f"{MAKE}; sys.exit(137)", "print('went on')")
    progress, _ = run_all([job])
    assert [a.code for a in progress.states["a"].attempts] == [137, 0]


def test_an_unknown_launcher_is_told_in_one_line(tmp_path, error_line):
    error_line("make_launcher('slrm', 2, DIR)", lambda: make_launcher("slrm", 2, tmp_path))


class AtOnce:
    """Has room for two jobs; each is done at the second look after it was handed over."""

    def __init__(self):
        self.most, self.running = 0, {}

    def free_slots(self):
        return 2 - len(self.running)

    def submit(self, folder):
        self.running[folder] = 2
        self.most = max(self.most, len(self.running))
        return folder

    def has_ended(self, handle):
        self.running[handle] -= 1
        if self.running[handle] == 0:
            save_state(handle, State(phase="done"))
            del self.running[handle]
            return True
        return False

    def stop(self, handle):
        raise AssertionError("nothing is to be stopped")

    def close(self):
        assert not self.running


def test_a_look_costs_what_runs_and_not_what_waits_or_is_done(tmp_path, monkeypatch):
    """Every state is read a few times, however many jobs there are."""
    jobs = [job_of(tmp_path / f"{k:03}") for k in range(60)]
    read = []

    def counted(folder):
        read.append(folder)
        return load_state(folder)

    monkeypatch.setattr("articulate.jobs.launcher.load_state", counted)
    monkeypatch.setattr("articulate.jobs.launcher.MIN_POLL_S", 0.0)
    launcher = AtOnce()
    progress = run_jobs(jobs, launcher, lambda _: None)
    assert progress.count("done") == 60
    assert launcher.most == 2
    assert len(read) <= 4 * 60


def test_a_job_that_runs_elsewhere_is_waited_for_and_takes_no_room(tmp_path):
    mine = save_job(job_of(tmp_path / "a"))
    wait = "import pathlib, sys, time; pathlib.Path(sys.argv[1]).mkdir(); time.sleep(1)"
    other = save_job(job_of(tmp_path / "c", wait))
    worker = subprocess.Popen([sys.executable, "-m", "articulate.jobs.worker", str(other.folder)])
    until(other.run_folder.exists)
    progress, _ = run_all([other, mine], slots=1)
    assert progress.count("done") == 2
    assert worker.wait() == 0
    assert len(load_state(other.folder).attempts) == 1


def test_interrupting_the_loop_stops_the_workers(tmp_path):
    wait = "import pathlib, sys, time; pathlib.Path(sys.argv[1]).mkdir(); time.sleep(60)"
    jobs = [job_of(tmp_path / name, wait) for name in "abc"]

    def interrupt(progress):
        if progress.count("running") == 1 and jobs[0].run_folder.exists():
            raise KeyboardInterrupt

    launcher = LocalLauncher(1, tmp_path)
    with pytest.raises(KeyboardInterrupt):
        run_jobs(jobs, launcher, Repeated(interrupt, jobs[0].run_folder))
    assert not is_leased(jobs[0].folder)
    assert not (jobs[1].folder / STATE).exists()
    assert (jobs[0].folder / LOG).exists()


class Repeated:
    """Waits for the job's folder, since the loop tells of changes alone."""

    def __init__(self, call, made):
        self.call, self.made = call, made

    def __call__(self, progress):
        if progress.count("running"):
            until(self.made.exists)
        self.call(progress)


def command_runs(job: Job) -> bool:
    """Whether a process with the job's command line runs."""
    found = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True)
    return any(
        str(job.run_folder) in line and "time.sleep" in line for line in found.stdout.splitlines()
    )


def until(there, limit_s=20.0):
    """Wait for what another process does."""
    end = time.monotonic() + limit_s
    while not there():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)


@pytest.fixture(autouse=True)
def restored_signals():
    before = {s: signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGINT)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
