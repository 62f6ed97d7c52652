"""Run a command on a hostile input, and list what is wrong with its answer."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from tests.hostile.reader import Case
from tests.hostile.writers import SECRET, HonestInputs

MAX_CPU_S = 60
MAX_BYTES = 2_000_000_000
MAX_WALL_S = 300
"""Time after which a command counts as hanging, on a busy machine [s]."""
MAX_LINE = 600
ADDRESS_SPACE = 32_000_000_000
"""Address space of the command, so that no case takes all memory; the code of torch and the stacks
of threads reserve several GB of it [bytes]."""
MAX_QUOTED = re.compile(r"(.)\1{200}")
"""A message that quotes more than 200 characters of a long name."""
CODES = (2, 3)
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Exit code, output and cost of a command."""

    code: int
    """Exit code; minus the number of a signal."""
    stdout: str
    stderr: str
    cpu_s: float = 0.0
    peak_bytes: int = 0


def prepare(case: Case, folder: Path, honest: HonestInputs) -> dict[str, str]:
    """Write the input of a case into ``folder`` and return the environment of its command."""
    (folder / "secret").write_text(f"{SECRET}\n")
    case.write(folder, honest)
    environment = {"OMP_NUM_THREADS": "1", "MUJOCO_GL": "egl", "PYTHONWARNINGS": "ignore"}
    for name, variable in (("home", "HOME"), ("cache", "XDG_CACHE_HOME"), ("tmp", "TMPDIR")):
        (folder / name).mkdir()
        environment[variable] = str(folder / name)
    return environment


def run_process(case: Case, folder: Path, environment: dict[str, str]) -> Outcome:
    """Run the command of a case in a process of limited time, memory and address space."""
    module = "tests.hostile.run_program" if case.reader.argv[0] == "program" else "articulate"
    argv = [sys.executable, "-m", module, *arguments(case)]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    with (folder / "stdout").open("wb") as out, (folder / "stderr").open("wb") as err:
        process = subprocess.Popen(
            argv,
            cwd=folder,
            env={**os.environ, **environment, "PYTHONPATH": path},
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
            preexec_fn=limit_resources,  # noqa: PLW1509  # tests have no other threads here
        )
        timer = threading.Timer(MAX_WALL_S, os.killpg, (process.pid, signal.SIGKILL))
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)  # children that have ended are counted as well
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
    return Outcome(
        code=process.returncode,
        stdout=(folder / "stdout").read_text(errors="replace"),
        stderr=(folder / "stderr").read_text(errors="replace"),
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak_bytes=1024 * usage.ru_maxrss,
    )


def arguments(case: Case) -> list[str]:
    """Return the arguments of the command after its module."""
    if case.reader.argv[0] == "program":
        return list(case.reader.argv[1:])
    return [*case.reader.argv, "--quiet"]


def limit_resources() -> None:
    """Limit this process; longer or larger ones are killed."""
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S + 5))
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


OWN = ("out", "out.mp4", "out.png", "cache", "stdout", "stderr")
"""Paths that a command may write, and those of the harness."""


def snapshot(folder: Path) -> dict[str, tuple[int, ...]]:
    """Return type, size and time of change of all files outside the output and the cache."""
    found = {}
    for base, folders, names in os.walk(folder):
        at = Path(base)
        if at == folder:
            folders[:] = [name for name in folders if name not in OWN]
        for name in (*folders, *names):
            path = at / name
            if at == folder and name in OWN:
                continue
            state = path.lstat()
            times = () if name in folders else (state.st_mtime_ns, state.st_size)
            found[str(path.relative_to(folder))] = (state.st_mode, *times)
    return found


def problems(outcome: Outcome, folder: Path, before: dict[str, tuple[int, ...]]) -> list[str]:
    """List what is wrong with the answer to a hostile input; empty if nothing."""
    found = _in_output(outcome, folder)
    if outcome.cpu_s > MAX_CPU_S:
        found.append(f"{outcome.cpu_s:.0f} s of processor time")
    if outcome.peak_bytes > MAX_BYTES:
        found.append(f"{outcome.peak_bytes / 1e9:.1f} GB")
    after = snapshot(folder)
    changed = sorted(name for name in {*before, *after} if before.get(name) != after.get(name))
    if changed:
        found.append(f"changed outside the output: {changed[:4]}")
    out = folder / "out"
    left = out.exists() and (not out.is_dir() or any(out.iterdir()))
    if outcome.code == 2 and (left or (folder / "out.mp4").exists()):
        found.append("files in the output")
    return found


def _in_output(outcome: Outcome, folder: Path) -> list[str]:
    """List what is wrong with exit code and output."""
    found = []
    errors = outcome.stderr.splitlines()
    if outcome.code not in CODES:
        found.append(f"exit {outcome.code}")
    is_error = outcome.code == 2 and len(errors) == 1 and not outcome.stdout
    is_verdict = outcome.code == 3 and len(errors) <= 1 and outcome.stdout
    if not (is_error or is_verdict):
        found.append(f"{len(errors)} lines of errors, {len(outcome.stdout)} characters of results")
    for line in [*errors, *outcome.stdout.splitlines()]:
        short = line.replace(str(folder), "")
        if len(short) > MAX_LINE:
            found.append(f"a line of {len(short)} characters")
        if MAX_QUOTED.search(short):
            found.append("a line that quotes more than 200 characters")
        if not short.isprintable():
            found.append("a line with control characters")
    text = outcome.stdout + outcome.stderr
    return found + [f"{word} in the output" for word in ("Traceback", SECRET) if word in text]
