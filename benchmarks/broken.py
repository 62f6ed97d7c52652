"""Check files that are broken as found, each by a command of its own: a verdict, or one line.

python benchmarks/broken.py --data data --out broken --json

The data folder holds ``broken.json``: for each file what is wrong with it and which verdict one
person finds fair (``expected``), which is shown beside ours and not compared with it. A clear
verdict is an exit with 0 or 3 and a proof, or with 2 and one line on standard error, and never the
end of a process that was not meant to end.
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
"""A check that takes longer has no verdict [s]."""
ENDED = ("its process ended", "a library crashed")
"""What stands in the reason where a check was not meant to end so."""


def checked(item: dict[str, Any], file: Path, out: Path) -> dict[str, Any]:
    """Return the result of ``articulate check`` for one file."""
    command = [sys.executable, "-m", "articulate", "check", str(file), "--out", str(out), "--json"]
    start = time.perf_counter()
    row: dict[str, Any] = {"id": item["id"], "expected": item["expected"], "clear": False}
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        return row | {"exit": None, "said": f"stopped after {LIMIT_S:g} s"}
    row |= {"exit": done.returncode, "seconds": round(time.perf_counter() - start, 2)}
    if done.returncode in (0, 3):
        check_report = json.loads(done.stdout)
        said = (check_report["reasons"] or check_report["repairs"])[:2]
        clear = not any(word in reason for word in ENDED for reason in check_report["reasons"])
        return row | {"verdict": check_report["verdict"], "said": said, "clear": clear}
    lines = done.stderr.strip().splitlines()
    clear = done.returncode == 2 and len(lines) == 1 and not done.stdout
    return row | {"verdict": "rejected", "said": lines[-1:], "clear": clear}


def main() -> int:
    """Print a row for each file and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True, help="an asset folder for each file")
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
    items = json.loads((flags.data / "broken.json").read_text(encoding="utf-8"))["items"]
    rows = []
    for item in items:
        row = checked(item, flags.data / item["file"], flags.out / item["id"])
        print(f"{row['id']}: {row.get('verdict')} {row['said']}", file=sys.stderr, flush=True)
        rows.append(row)
    count = {
        v: sum(r.get("verdict") == v for r in rows) for v in ("passed", "repaired", "rejected")
    }
    result = {"files": len(rows), "clear": sum(r["clear"] for r in rows), **count, "rows": rows}
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
