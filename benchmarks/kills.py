"""Kill a training at random moments, resume it each time, and compare with an unkilled one.

python benchmarks/kills.py --kills 50 --out kills --json

All processes of the run receive SIGKILL after a random time between 0 and ``--longest``, so that
kills happen during the start, updates and writes. The run is then resumed. After the last kill it
continues to its end. Its checkpoint must then equal that of the unkilled run, bit by bit.
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
KILLED = -signal.SIGKILL


def command(*arguments: str) -> list[str]:
    """Return the command ``train`` with these arguments."""
    return [sys.executable, "-m", "articulate", "train", *arguments]


def run_to_end(arguments: Sequence[str]) -> None:
    """Run ``train`` to its end."""
    done = subprocess.run(command(*arguments), capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(arguments)}: exit {done.returncode}: {done.stderr[-2000:]}")


def run_killed(arguments: Sequence[str], life_s: float) -> tuple[int, str]:
    """Run ``train`` for ``life_s`` [s], then kill all of its processes.

    Returns:
        Exit status and the end of standard error.
    """
    process = subprocess.Popen(
        command(*arguments),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        _, messages = process.communicate(timeout=life_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        _, messages = process.communicate()
    return process.returncode, messages[-500:]


def flattened(content: Any, name: str = "") -> dict[str, Any]:
    """Return every array and value of a checkpoint by its path."""
    if isinstance(content, dict):
        out: dict[str, Any] = {}
        for key, value in content.items():
            out |= flattened(value, f"{name}.{key}" if name else str(key))
        return out
    if isinstance(content, (list, tuple)):
        return flattened({str(k): v for k, v in enumerate(content)}, name)
    return {name: np.asarray(content)}


def differing(one: Path, other: Path) -> list[str]:
    """Return the names of the values that differ between two checkpoints."""
    first, second = (flattened(read_checkpoint(folder)) for folder in (one, other))
    return sorted(
        name
        for name in first.keys() | second.keys()
        if name not in first
        or name not in second
        or first[name].tobytes() != second[name].tobytes()
    )


def main() -> int:
    """Train twice, once with kills, and print the differences."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of both runs")
    parser.add_argument("--kills", type=int, default=50, help="number of kills")
    parser.add_argument(
        "--longest", type=float, default=20.0, help="longest time before a kill [s]"
    )
    parser.add_argument("--steps", type=int, default=120_000, help="control steps")
    parser.add_argument("--seed", type=int, default=0, help="seed of the times of the kills")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    flags = parser.parse_args()
    flags.out.mkdir(parents=True, exist_ok=True)
    cabinet = embedded_cabinet(flags.out / "cabinet")
    common = ["--asset", str(cabinet), "--steps", str(flags.steps), *COMMON]
    unkilled, killed = flags.out / "unkilled", flags.out / "killed"
    run_to_end([*common, "--out", str(unkilled)])
    rng = np.random.default_rng(flags.seed)
    lives: list[dict[str, Any]] = []

    def arguments() -> list[str]:
        """Return the arguments that start the run, or resume it if it has begun."""
        resumed = (killed / "config.yaml").is_file()
        return [*(["--resume", "--no-evaluate"] if resumed else common), "--out", str(killed)]

    while len(lives) < flags.kills:
        life_s = float(rng.uniform(0.0, flags.longest))
        current = arguments()
        code, messages = run_killed(current, life_s)
        if code == 0:
            break  # the training is finished
        if code != KILLED:
            raise SystemExit(f"after {len(lives)} kills: exit {code}: {messages}")
        lives.append({"life_s": round(life_s, 2), "resumed": "--resume" in current})
        print(f"{len(lives):3d} killed after {life_s:5.1f} s", file=sys.stderr, flush=True)
    begin = time.monotonic()
    run_to_end(arguments())
    differences = differing(unkilled / "seed_0", killed / "seed_0")
    result = {
        "kills": len(lives),
        "identical": not differences,
        "differing": differences,
        "last_life_s": round(time.monotonic() - begin, 1),
        "steps": flags.steps,
        "lives": lives,
    }
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0 if not differences else 1


if __name__ == "__main__":
    sys.exit(main())
