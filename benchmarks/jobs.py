"""What a launcher costs: so many jobs that do nothing, and where the time goes.

A job is a worker of Python that looks after a command; the command here is ``/bin/true``. The
cost of starting Python is measured beside it, so that what is ours can be told apart. Slurm is
played by a stub of its commands that runs what is submitted on this machine; Ray runs on a
cluster of this machine alone.

    python benchmarks/jobs.py --count 10000 --json
    python benchmarks/jobs.py --count 200 --launcher slurm --json
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import stat
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from articulate.jobs.job import Job, save_job
from articulate.jobs.launcher import make_launcher, run_jobs

STARTS = 20
"""Processes that are started to find what Python costs by itself."""
SBATCH = """#!{python}
import os, pathlib, subprocess, sys
number = str(abs(hash((os.getpid(), sys.argv[-1]))) % 10**9)
environment = dict(os.environ, SLURM_JOB_ID=number, SLURM_JOB_NODELIST="here", SLURM_NTASKS="1",
                   SLURM_LOCALID="0", SLURM_NODEID="0", SLURM_PROCID="0", SLURM_JOB_NUM_NODES="1")
text = pathlib.Path(sys.argv[-1]).read_text().replace("%j", number)
path = pathlib.Path(sys.argv[-1] + "." + number)
path.write_text(text)
subprocess.Popen(["bash", str(path)], env=environment, start_new_session=True,
                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print("Submitted batch job " + number)
"""
SRUN = '#!/usr/bin/env bash\nwhile [[ ! -x "$1" ]]; do shift; done\nexec "$@"\n'
SACCT = "#!/usr/bin/env bash\necho 'JobID|State|NodeList'\n"


@dataclass(frozen=True)
class Costs:
    """What so many empty jobs took."""

    launcher: str
    count: int
    slots: int
    done: int
    prepare_s: float
    """Writing every job's folder before anything runs, wall clock [s]."""
    wall_s: float
    """All of it, wall clock [s]."""
    launcher_cpu_s: float
    """Time of the processor in the launcher's own process [s]."""
    workers_cpu_s: float
    """Time of the processor in what it started and waited for [s]."""
    launcher_cpu_ms_per_job: float
    workers_cpu_ms_per_job: float
    python_cpu_ms: float
    """Time of the processor that ``python -c pass`` takes [ms]."""
    worker_import_cpu_ms: float
    """The same with the worker's imports, nothing run [ms]."""
    again_s: float
    """A second call over the same folders, in which nothing is left to do, wall clock [s]."""
    files_per_job: float
    bytes_per_job: float
    processors: int
    machine: str


def measure(count: int, slots: int, launcher: str, folder: Path) -> Costs:
    """Run ``count`` empty jobs through ``launcher`` with ``slots`` of them side by side."""
    python_ms, worker_ms = start_cost_ms("pass"), start_cost_ms("import articulate.jobs.worker")
    width = len(str(count))
    jobs = [
        Job(folder=folder / "jobs" / f"job-{k:0{width}d}", start=("/bin/true",), go_on=("true",))
        for k in range(count)
    ]
    begun = time.perf_counter()
    for job in jobs:
        save_job(job)
    prepared = time.perf_counter()
    own, children = time.process_time(), _children_s()
    seen = [0]

    def on_change(progress: object) -> None:
        seen[0] += 1

    progress = run_jobs(jobs, make_launcher(launcher, slots, folder), on_change)
    ended = time.perf_counter()
    own, children = time.process_time() - own, _children_s() - children
    run_jobs(jobs, make_launcher("local", slots, folder), on_change)
    again = time.perf_counter() - ended
    sizes = [p.stat().st_size for job in jobs for p in job.folder.iterdir() if p.is_file()]
    return Costs(
        launcher=launcher,
        count=count,
        slots=slots,
        done=progress.count("done"),
        prepare_s=prepared - begun,
        wall_s=ended - begun,
        launcher_cpu_s=own,
        workers_cpu_s=children,
        launcher_cpu_ms_per_job=1e3 * own / count,
        workers_cpu_ms_per_job=1e3 * children / count,
        python_cpu_ms=python_ms,
        worker_import_cpu_ms=worker_ms,
        again_s=again,
        files_per_job=len(sizes) / count,
        bytes_per_job=sum(sizes) / count,
        processors=len(os.sched_getaffinity(0)),
        machine=platform.processor() or platform.machine(),
    )


def start_cost_ms(code: str) -> float:
    """Time of the processor that a process of Python takes for ``code``, the mean of some [ms]."""
    before = _children_s()
    for _ in range(STARTS):
        subprocess.run([sys.executable, "-c", code], check=True)
    return 1e3 * (_children_s() - before) / STARTS


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def play_slurm(folder: Path) -> None:
    """Put commands that look like Slurm's before all others."""
    folder.mkdir(parents=True)
    stubs = {"sbatch": SBATCH.format(python=sys.executable), "srun": SRUN, "sacct": SACCT}
    for name, text in stubs.items():
        path = folder / name
        path.write_text(text, encoding="utf-8")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    os.environ["PATH"] = f"{folder}:{os.environ['PATH']}"


def text(costs: Costs) -> str:
    """A few lines for people."""
    own = costs.launcher_cpu_ms_per_job
    return "\n".join(
        [
            f"{costs.done} of {costs.count} jobs done by {costs.launcher}, {costs.slots} at a time",
            f"  wall clock  {costs.wall_s:.1f} s, of which {costs.prepare_s:.1f} s for the folders",
            f"  launcher    {own:.2f} ms of the processor for each job",
            f"  worker      {costs.workers_cpu_ms_per_job:.1f} ms for each job; starting Python "
            f"takes {costs.python_cpu_ms:.1f} ms, with imports {costs.worker_import_cpu_ms:.1f} ms",
            f"  again       {costs.again_s:.2f} s where all is done already",
            f"  storage     {costs.files_per_job:.1f} files, {costs.bytes_per_job:.0f} bytes a job",
        ]
    )


def main() -> int:
    """Measure and print; 1 if a job was not done."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--slots", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--launcher", choices=("local", "slurm", "ray"), default="local")
    parser.add_argument("--json", action="store_true")
    flags = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="articulate-jobs-") as name:
        if flags.launcher == "slurm":
            play_slurm(Path(name) / "bin")
        costs = measure(flags.count, flags.slots, flags.launcher, Path(name))
    print(json.dumps(asdict(costs), indent=1) if flags.json else text(costs))
    return 0 if costs.done == costs.count else 1


if __name__ == "__main__":
    sys.exit(main())
