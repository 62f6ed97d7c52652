"""Ids of a random sample of the objects of ``assets.json``, the same on each call.

python benchmarks/sample.py --data ../shared/data --count 20
python benchmarks/sample.py --data ../shared/data --count 60 --truth mobility_v2 --seed 20261123
"""

from __future__ import annotations

import argparse
import json
import random
import sys
from pathlib import Path


def main() -> int:
    """Print the first ids of the shuffled index."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--truth", default=None, help="only objects whose joints are known so")
    parser.add_argument("--seed", type=int, default=1, help="of the order")
    flags = parser.parse_args()
    entries = json.loads((flags.data / "assets.json").read_text(encoding="utf-8"))["assets"]
    ids = [e["id"] for e in entries if flags.truth is None or e.get("truth") == flags.truth]
    random.Random(flags.seed).shuffle(ids)
    print(*ids[: flags.count])
    return 0


if __name__ == "__main__":
    sys.exit(main())
