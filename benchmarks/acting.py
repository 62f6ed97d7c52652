"""Who of a seed's members acts, asked of runs that were trained before that was asked.

python benchmarks/acting.py runs/cabinet --write
evaluate runs/cabinet

What a training asks at its end, of the same state and on the same draws, so that a run has the
policies then that it would have if it were trained anew. Without ``--write`` nothing is changed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from articulate.files import write_json
from articulate_train.checkpoint_selection import MemberScore, choose_acting
from articulate_train.policy import ACTS, CHOSEN, read_checkpoint, write_state
from articulate_train.run import DONE, Run, open_run


def asked(run: Run, seed: int, *, write: bool) -> str:
    """How the members of one seed did, and who acts."""
    folder = run.seed_folder(seed)
    found = choose_acting(run, seed, read_checkpoint(folder, CHOSEN), threads=1)
    assert found is not None  # nothing stops it
    state, acted = found
    if write:
        done = json.loads((folder / DONE).read_text(encoding="utf-8"))
        done |= {"members": [asdict(one) for one in acted], "acts": state.get(ACTS)}
        write_state(folder / CHOSEN, state)
        write_json(folder / DONE, done)
    acts = state.get(ACTS)
    rates = "; ".join(told(one) for one in acted)
    return f"seed {seed} [%]: {rates}: {'all act' if acts is None else f'member {acts} acts'}"


def told(acted: MemberScore) -> str:
    """Success of all or of one, and with wider ranges [%]."""
    who = "all" if acted.alone is None else f"member {acted.alone}"
    own = f"{100 * acted.successes / acted.episodes:.1f} of {acted.episodes}"
    if not acted.wider_episodes:
        return f"{who} {own}"
    share = 100 * acted.wider_successes / acted.wider_episodes
    return f"{who} {own}, wider {share:.1f} of {acted.wider_episodes}"


def main(argv: Sequence[str] | None = None) -> int:
    """Print a line a seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folders of runs")
    parser.add_argument("--seeds", nargs="+", type=int, metavar="K", help="by default all")
    parser.add_argument("--write", action="store_true", help="change the policies of the runs")
    args = parser.parse_args(argv)
    for folder in args.runs:
        run = open_run(folder)
        for seed in args.seeds or run.config.seeds:
            print(f"{folder.name} {asked(run, seed, write=args.write)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
