"""Kill a training at random moments, go on each time, and compare with one left alone.

python benchmarks/kills.py --kills 50 --out /tmp/kills --json

Every life of the run is ended by SIGKILL to all of its processes after a time drawn between
nothing and ``--longest``, so that kills fall into the start, updates and writes alike. After the
last one the run goes on to its end; all that its checkpoint holds must then be the same, bit by
bit, as that of a run that nobody killed.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from articulate.library.procedural.cabinet import embedded_cabinet
from articulate_train.policy import read_checkpoint

COMMON = (
    "--task", "open_drawer", "--seeds", "0", "--no-evaluate", "--checkpoint-updates", "3",
    "--set", "ppo.n_envs=16", "--set", "ppo.n_steps=16", "--set", "ppo.batch_size=64",
    "--set", "ppo.n_epochs=2",
)  # fmt: skip
ENDED = -signal.SIGKILL


def command(*arguments: str) -> list[str]:
    """``train`` with these arguments."""
    return [sys.executable, "-m", "articulate", "train", *arguments]


def run_whole(arguments: Sequence[str]) -> None:
    """Run ``train`` to its end."""
    done = subprocess.run(command(*arguments), capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(arguments)}: exit {done.returncode}: {done.stderr[-2000:]}")


def run_killed(arguments: Sequence[str], life_s: float) -> tuple[int, str]:
    """Run ``train`` for ``life_s`` [s], kill all of its processes; exit status and last words."""
    process = subprocess.Popen(
        command(*arguments),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        _, said = process.communicate(timeout=life_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        _, said = process.communicate()
    return process.returncode, said[-500:]


def flattened(content: Any, name: str = "") -> dict[str, Any]:
    """Every array and value of a checkpoint by its path."""
    if isinstance(content, dict):
        out: dict[str, Any] = {}
        for key, value in content.items():
            out |= flattened(value, f"{name}.{key}" if name else str(key))
        return out
    if isinstance(content, (list, tuple)):
        return flattened({str(k): v for k, v in enumerate(content)}, name)
    return {name: np.asarray(content)}


def differing(one: Path, other: Path) -> list[str]:
    """Names of what two checkpoints hold differently."""
    first, second = (flattened(read_checkpoint(folder)) for folder in (one, other))
    return sorted(
        name
        for name in first.keys() | second.keys()
        if name not in first
        or name not in second
        or first[name].tobytes() != second[name].tobytes()
    )


def main() -> int:
    """Train twice, once with kills, and print what differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--longest", type=float, default=20.0, help="longest life [s]")
    parser.add_argument("--steps", type=int, default=120_000)
    parser.add_argument("--seed", type=int, default=0, help="of the moments of the kills")
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
    flags.out.mkdir(parents=True, exist_ok=True)
    cabinet = embedded_cabinet(flags.out / "cabinet")
    common = ["--asset", str(cabinet), "--steps", str(flags.steps), *COMMON]
    whole, killed = flags.out / "whole", flags.out / "killed"
    run_whole([*common, "--out", str(whole)])
    rng = np.random.default_rng(flags.seed)
    lives: list[dict[str, Any]] = []

    def arguments() -> list[str]:
        """Return the command that starts the run, or resumes it if there is something to resume."""
        there = (killed / "config.yaml").is_file()
        return [*(["--resume", "--no-evaluate"] if there else common), "--out", str(killed)]

    while len(lives) < flags.kills:
        life_s = float(rng.uniform(0.0, flags.longest))
        given = arguments()
        code, said = run_killed(given, life_s)
        if code == 0:
            break  # it came to its end: no more moments to kill it at
        if code != ENDED:
            raise SystemExit(f"life {len(lives)}: exit {code}: {said}")
        lives.append({"life_s": round(life_s, 2), "resumed": "--resume" in given})
        print(f"{len(lives):3d} killed after {life_s:5.1f} s", file=sys.stderr, flush=True)
    begin = time.monotonic()
    run_whole(arguments())
    bad = differing(whole / "seed_0", killed / "seed_0")
    result = {
        "kills": len(lives),
        "went_on": len(lives),
        "identical": not bad,
        "differing": bad,
        "last_life_s": round(time.monotonic() - begin, 1),
        "steps": flags.steps,
        "lives": lives,
    }
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0 if not bad else 1


if __name__ == "__main__":
    sys.exit(main())
