"""Slurm through submitit: its own stand-in, and a stub of Slurm's commands. No real cluster."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

import pytest
from tests.articulate.jobs.test_jobs import job_of

pytest.importorskip("submitit", reason="submitit is not installed: pip install the extra cluster")

from articulate.jobs.job import load_state
from articulate.jobs.launcher import make_launcher, run_jobs
from articulate.jobs.slurm import SlurmLauncher

SBATCH = """#!{python}
import os, pathlib, subprocess, sys
script = pathlib.Path(sys.argv[-1]).read_text()
pathlib.Path("{log}").open("a").write(script)
environment = dict(os.environ, SLURM_JOB_ID="42", SLURM_JOB_NODELIST="here", SLURM_NTASKS="1",
                   SLURM_LOCALID="0", SLURM_NODEID="0", SLURM_PROCID="0", SLURM_JOB_NUM_NODES="1")
subprocess.Popen(["bash", sys.argv[-1]], env=environment, start_new_session=True,
                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print("Submitted batch job 42")
"""
SRUN = '#!/usr/bin/env bash\nwhile [[ ! -x "$1" ]]; do shift; done\nexec "$@"\n'
SACCT = "#!/usr/bin/env bash\necho 'JobID|State|NodeList'; echo '42|RUNNING|here'\n"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # its processes
def test_jobs_run_under_submitits_own_stand_in(tmp_path):
    jobs = [job_of(tmp_path / name) for name in "ab"]
    launcher = SlurmLauncher(2, tmp_path / "own", cluster="local")
    assert run_jobs(jobs, launcher, lambda _: None).count("done") == 2


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """A folder of commands that look like Slurm's; what was submitted is kept in its log."""
    folder, log = tmp_path / "bin", tmp_path / "submitted.sh"
    folder.mkdir()
    stubs = {"sbatch": SBATCH.format(python=sys.executable, log=log), "srun": SRUN, "sacct": SACCT}
    for name, text in stubs.items():
        path = folder / name
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    return log


def test_jobs_are_handed_to_sbatch_with_what_they_need(tmp_path, slurm):
    job = job_of(tmp_path / "a")
    launcher = make_launcher("slurm", 4, tmp_path / "own")
    assert run_jobs([job], launcher, lambda _: None).count("done") == 1
    assert load_state(job.folder).attempts[0].code == 0
    script = slurm.read_text()
    assert "#SBATCH --cpus-per-task=1" in script
    assert "#SBATCH --job-name=articulate" in script
    assert "submitit" in script


def test_a_machine_without_slurm_is_told_what_else_to_take(tmp_path, monkeypatch, error_line):
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent))
    error_line(
        "make_launcher('slurm', 2, DIR)  # no sbatch", lambda: make_launcher("slurm", 2, tmp_path)
    )
