"""Check mutated URDFs, and count tracebacks, crashes, hangs and files in other folders.

python benchmarks/fuzz.py --count 2000 --seed 0 --jobs 2 --json

Each mutant (``mutants.py``) is converted and checked in a separate process, with separate
folders for work, temporary files and output. The result counts verdicts, unexpected exceptions,
crashes of native libraries, checks that run longer than 60 s, and files outside the output folder.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from articulate.errors import ArticulateError
from articulate.preparation.prepare import check_asset
from mutants import Mutant, sample_mutant, write_mutant

LIMIT_S = 60.0
"""A check that runs longer hangs [s]."""
LONGEST_LINE = 8000
"""A reason that is longer is no line that a person reads [characters]."""


@dataclass(frozen=True)
class Outcome:
    """Result of one mutant."""

    index: int
    kind: str
    """A verdict, or ``error`` (one line of ours), ``traceback``, ``crash``, ``hang``, ``stray``."""
    text: str
    seconds: float


def _checked(urdf: Path, home: Path, answer: Connection) -> None:
    """Check ``urdf`` with everything that might be written below ``home``; runs in a child."""
    for name in ("cwd", "tmp"):
        (home / name).mkdir()
    os.chdir(home / "cwd")
    os.environ["TMPDIR"] = tempfile.tempdir = str(home / "tmp")
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    try:
        check_report = check_asset(urdf, home / "made" / "out")
        reasons = check_report.reasons
        broken = [r for r in reasons if "\n" in r or len(r) > LONGEST_LINE]
        answer.send(
            ("traceback" if broken else check_report.verdict, (broken or [*reasons, ""])[0])
        )
    except ArticulateError as error:
        answer.send(("error" if "\n" not in str(error) else "traceback", str(error)))
    except BaseException:  # noqa: BLE001  # whatever it is, it is what is looked for
        answer.send(("traceback", traceback.format_exc()))


def outcome_of(index: int, mutant: Mutant) -> Outcome:
    """Check one mutant in a forked process."""
    start = time.perf_counter()
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        home = Path(name)
        urdf = write_mutant(mutant, home)
        before = set(home.rglob("*"))
        here, there = context.Pipe(duplex=False)
        child = context.Process(target=_checked, args=(urdf, home, there))
        child.start()
        there.close()
        kind, text = "hang", f"longer than {LIMIT_S:g} s"
        try:
            if here.poll(LIMIT_S):
                kind, text = here.recv()
        except EOFError:
            kind, text = "crash", ""
        if kind == "hang":
            child.kill()
        child.join()
        if kind == "crash":
            text = f"its process ended with {child.exitcode}"
        allowed = {home / x for x in ("cwd", "tmp", "made")} | {home / "made" / "out"}
        stray = [
            p.relative_to(home).as_posix()
            for p in set(home.rglob("*")) - before - allowed
            if home / "made" / "out" not in p.parents
        ]
        if stray and kind not in ("hang", "crash"):
            kind, text = "stray", stray[0]
    return Outcome(index, kind, text, time.perf_counter() - start)


def main() -> int:
    """Check the mutants, print those that failed and the sums."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=2000, help="number of mutants")
    parser.add_argument("--seed", type=int, default=0, help="seed of the mutants")
    parser.add_argument("--only", type=int, nargs="*", help="mutants of these numbers only")
    parser.add_argument("--jobs", type=int, default=2, help="mutants checked at the same time")
    parser.add_argument("--json", action="store_true", help="print only the result, as JSON")
    flags = parser.parse_args()
    rng = np.random.default_rng(flags.seed)
    mutants = [(k, sample_mutant(rng)) for k in range(flags.count)]
    wanted = [m for m in mutants if not flags.only or m[0] in flags.only]
    done: list[Outcome] = []
    # Workers have one thread each, so that what they fork finds no lock taken.
    workers = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(flags.jobs, mp_context=workers) as pool:
        for outcome in pool.map(outcome_of, *zip(*wanted, strict=True)):
            done.append(outcome)
            if outcome.kind in ("traceback", "crash", "hang", "stray") or flags.only:
                print(f"{outcome.index} {outcome.kind}: {outcome.text}", file=sys.stderr)
            if len(done) % 100 == 0:
                print(f"{len(done)} of {len(wanted)}", file=sys.stderr, flush=True)
    seconds = sorted(o.seconds for o in done)
    result = {
        "seed": flags.seed,
        "mutants": len(done),
        "kinds": dict(Counter(o.kind for o in done).most_common()),
        "seconds_median": round(seconds[len(seconds) // 2], 2),
        "seconds_most": round(seconds[-1], 2),
        "bad": [
            {"index": o.index, "kind": o.kind, "text": o.text[-2000:]}
            for o in done
            if o.kind in ("traceback", "crash", "hang", "stray")
        ],
    }
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
