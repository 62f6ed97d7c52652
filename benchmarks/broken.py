"""Check files with real defects, and count the clear results: a verdict or one line of error.

python benchmarks/broken.py --data data --out broken --json

The data folder holds ``broken.json``: ``items`` with ``id``, ``file`` and ``expected``, the verdict
that a person considers right. ``expected`` is copied to the result and not compared. Each file is
checked by a separate command. A result is clear if the exit code is 0 or 3 with a check report, or
2 with one line on standard error. It is not clear if a process of the check crashed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

LIMIT_S = 300.0
"""Time limit of a check [s]."""
CRASHES = ("its process ended", "a library crashed")
"""Texts in the reasons of a check report after a crash."""


def check_file(item: dict[str, Any], file: Path, out: Path) -> dict[str, Any]:
    """Return the result of ``articulate check`` for one file."""
    command = [sys.executable, "-m", "articulate", "check", str(file), "--out", str(out), "--json"]
    start = time.perf_counter()
    row: dict[str, Any] = {"id": item["id"], "expected": item["expected"], "clear": False}
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        return row | {"exit": None, "messages": [f"stopped after {LIMIT_S:g} s"]}
    row |= {"exit": done.returncode, "seconds": round(time.perf_counter() - start, 2)}
    if done.returncode in (0, 3):
        check_report = json.loads(done.stdout)
        messages = (check_report["reasons"] or check_report["repairs"])[:2]
        clear = not any(word in reason for word in CRASHES for reason in check_report["reasons"])
        return row | {"verdict": check_report["verdict"], "messages": messages, "clear": clear}
    lines = done.stderr.strip().splitlines()
    clear = done.returncode == 2 and len(lines) == 1 and not done.stdout
    return row | {"verdict": "rejected", "messages": lines[-1:], "clear": clear}


def main() -> int:
    """Print a row for each file and the counts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder that contains broken.json")
    parser.add_argument("--out", type=Path, required=True, help="folder of the asset folders")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    flags = parser.parse_args()
    items = json.loads((flags.data / "broken.json").read_text(encoding="utf-8"))["items"]
    rows = []
    for item in items:
        row = check_file(item, flags.data / item["file"], flags.out / item["id"])
        print(f"{row['id']}: {row.get('verdict')} {row['messages']}", file=sys.stderr, flush=True)
        rows.append(row)
    count = {
        v: sum(r.get("verdict") == v for r in rows) for v in ("passed", "repaired", "rejected")
    }
    result = {"files": len(rows), "clear": sum(r["clear"] for r in rows), **count, "rows": rows}
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
