"""Which objects are trained on: size, reach margins, and why others are skipped.

Walks the PartNet-Mobility objects of the data folder in numerical order until ``--count`` of
them have a drawer, convert and pass the reach test; ``--json`` prints the table.

    ARTICULATE_DATA=data python benchmarks/reach.py --count 2 --json
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from articulate.errors import UsageError
from articulate.library.procedural.cabinet import embedded_cabinet
from articulate_envs.joint_selection import choose_joint
from articulate_train.config import TrainConfig
from articulate_train.run import prepare_asset

SEKTION = "assets/isaacgymenvs/sektion_cabinet_model/urdf/sektion_cabinet.urdf"


def row(name: str, source: Path, task: str, cache: Path) -> dict[str, Any]:
    """What the reach test says of one object."""
    config = TrainConfig(asset=str(source), task=task)
    try:
        asset = prepare_asset(config, cache)
        chosen, place = choose_joint(config, asset)
    except UsageError as error:
        return {"object": name, "passes": False, "reason": str(error)}
    handle = asset.handle_of(chosen.joint)
    assert handle is not None
    size = [round(b - a, 3) for a, b in zip(*asset.bounds_o, strict=True)]
    return {
        "object": name,
        "passes": True,
        "category": asset.category,
        "size_m": size,
        "size_rule": asset.size_rule,
        "joint": chosen.joint,
        "travel": round(abs(chosen.span), 4),
        "target_fraction": round(chosen.target, 4),
        "handle": f"{handle.kind}, by {handle.source}",
        "joint_margin_rad": round(place.joint_margin_rad, 3),
        "manipulability": round(place.manipulability, 3),
        "drawn_share": place.drawn_share,
    }


def has_drawer(folder: Path) -> bool:
    """Whether the data set itself calls a sliding part of the object a drawer."""
    path = folder / "semantics.txt"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return any(line.split()[1:] == ["slider", "drawer"] for line in lines)


def table(data: Path, task: str, count: int) -> list[dict[str, Any]]:
    """Rows of the embedded cabinet, the sektion cabinet and PartNet objects until enough pass."""
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        rows = [row("cabinet", embedded_cabinet(Path(folder) / "cabinet"), task, cache)]
        if (data / SEKTION).exists():
            rows.append(row("sektion_cabinet", data / SEKTION, task, cache))
        found = 0
        for folder_k in sorted((data / "assets/partnet").iterdir(), key=lambda p: int(p.name)):
            k, urdf = folder_k.name, folder_k / "mobility.urdf"
            if found == count or not urdf.exists() or not has_drawer(folder_k):
                continue
            rows.append(row(f"partnet {k}", urdf, task, cache))
            found += rows[-1]["passes"]
            sys.stderr.write(f"{k}: {rows[-1].get('reason', 'passes')}\n")
    return rows


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2)
    parser.add_argument("--task", default="open_drawer")
    parser.add_argument("--json", action="store_true")
    flags = parser.parse_args()
    rows = table(Path(os.environ.get("ARTICULATE_DATA", "data")), flags.task, flags.count)
    print(json.dumps(rows, indent=1) if flags.json else "\n".join(map(str, rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
