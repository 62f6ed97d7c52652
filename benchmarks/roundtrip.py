"""Convert URDFs to programs and back, and compare the poses of all links.

python benchmarks/roundtrip.py data --json

For both files, yourdfpy computes the pose of every link relative to the root link at random joint
states.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import yourdfpy

from articulate.errors import AssetError
from articulate.reconstruct.program.decompile import decompile
from articulate.reconstruct.program.program_parts import parts_of
from articulate.reconstruct.program.result import ProgramError
from articulate.reconstruct.program.run import compile_program
from articulate.transforms import Array, normalised

JOINT_STATES = 20
"""Number of random joint states of each object."""
ALLOWED = 1e-6
"""Largest difference of an entry of a pose [m or 1]."""


@dataclass(frozen=True)
class Trip:
    """Result for one object."""

    id: str
    outcome: str
    """``same``, ``different``, ``rejected`` by the reader of URDFs, or ``not compiled``."""
    error: float | None = None
    """Largest difference of an entry of a pose."""
    links: int = 0
    joints: int = 0
    seconds: float = 0.0
    message: str = ""


def round_trip(object_id: str, urdf: Path, out: Path, rng: np.random.Generator) -> Trip:
    """Decompile ``urdf``, compile the program into ``out``, and compare."""
    start = time.perf_counter()
    try:
        source = decompile(urdf)
        found = compile_program(source, parts_of(urdf), out)
    except AssetError as error:
        return Trip(object_id, "rejected", message=str(error))
    if isinstance(found, ProgramError):
        return Trip(object_id, "not compiled", message=str(found))
    seconds = time.perf_counter() - start
    one, other = read(urdf), read(found)
    worst = difference(one, other, rng)
    return Trip(
        object_id,
        "same" if worst <= ALLOWED else "different",
        worst,
        len(one.link_map),
        len(one.actuated_joint_names),
        round(seconds, 2),
    )


def read(path: Path) -> yourdfpy.URDF:
    """Read the file with yourdfpy and normalize its axes, as the standard requires."""
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    robot = yourdfpy.URDF.load(str(path), load_meshes=False, load_collision_meshes=False)
    for joint in robot.robot.joints:
        if joint.axis is not None:
            joint.axis = normalised(joint.axis)
    return robot


def difference(one: yourdfpy.URDF, other: yourdfpy.URDF, rng: np.random.Generator) -> float:
    """Return the largest difference of any entry of a link's pose over random joint states.

    It is infinite if a link or a joint is missing.
    """
    links = list(one.link_map)
    if set(links) != set(other.link_map) or one.base_link not in other.link_map:
        return float("inf")
    if set(one.actuated_joint_names) != set(other.actuated_joint_names):
        return float("inf")
    worst = 0.0
    for _ in range(JOINT_STATES):
        q = state(one, rng)
        poses = [poses_of(robot, links, one.base_link, q) for robot in (one, other)]
        worst = max(worst, float(np.abs(poses[0] - poses[1]).max()))
    return worst


def state(robot: yourdfpy.URDF, rng: np.random.Generator) -> dict[str, float]:
    """Sample a position of each joint within its limits, or within a turn or a metre."""
    q = {}
    for name in robot.actuated_joint_names:
        limit = robot.joint_map[name].limit
        low, high = (None, None) if limit is None else (limit.lower, limit.upper)
        if low is None or high is None or abs(high - low) > 20.0:
            low, high = (-1.0, 1.0) if robot.joint_map[name].type == "prismatic" else (-3.0, 3.0)
        q[name] = float(rng.uniform(min(low, high), max(low, high)))
    return q


def poses_of(robot: yourdfpy.URDF, links: list[str], base: str, q: Mapping[str, float]) -> Array:
    """Return the poses (N, 4, 4) of ``links`` in the frame of ``base`` [m]."""
    robot.update_cfg(dict(q))
    return np.array([robot.get_transform(link, base) for link in links])


def main() -> None:
    """Convert all URDFs of ``assets.json``, or every n-th, and print the result."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder that contains assets.json and assets/")
    parser.add_argument("--index", type=Path, help="index of objects; by default DATA/assets.json")
    parser.add_argument("--every", type=int, default=1, help="use every n-th object only")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    flags = parser.parse_args()
    index = flags.index or flags.data / "assets.json"
    entries = json.loads(index.read_text(encoding="utf-8"))["assets"]
    entries = [entry for entry in entries if entry["format"] == "urdf"][:: flags.every]
    rng = np.random.default_rng(0)
    trips = []
    for entry in entries:
        with tempfile.TemporaryDirectory() as folder:
            trip = round_trip(entry["id"], flags.data / entry["path"], Path(folder), rng)
        print(f"{trip.id}: {trip.outcome} {trip.message}", file=sys.stderr)
        trips.append(trip)
    errors = [trip.error for trip in trips if trip.error is not None]
    result = {
        "objects": len(trips),
        "outcomes": dict(Counter(trip.outcome for trip in trips)),
        "worst_error": max(errors, default=None),
        "median_s": float(np.median([trip.seconds for trip in trips])) if trips else None,
        "trips": [asdict(trip) for trip in trips],
    }
    print(json.dumps(result, indent=1) if flags.json else result["outcomes"])


if __name__ == "__main__":
    main()
