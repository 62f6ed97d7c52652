"""Convex decomposition by CoACD in a child process, with a time limit and a cache.

As a program it reads vertices and faces and writes the corners of the convex parts::

    python -m articulate.geometry.convex_decomposition IN.npz OUT.npz TOLERANCE HULLS SECONDS
"""

from __future__ import annotations

import hashlib
import math
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from articulate.cache import touch
from articulate.files import atomic_write
from articulate.jobs.process_identity import end_with_parent
from articulate.transforms import Array

VERSION = "coacd-4"
"""Enters the cache key; change it with the options below."""
MAX_FACES = 60_000
"""Most triangles of a mesh that is decomposed."""
PATIENCE = 40.0
"""Wall-clock limit of a decomposition, as a multiple of its processor time limit."""


def decompose(
    mesh: trimesh.Trimesh, tol: float, most: int, *, time_s: float, cache_dir: Path | None = None
) -> list[Array] | None:
    """Return the corners (N, 3) [m] of convex parts, or None after a failure or the time limit.

    Args:
        mesh: Mesh to decompose [m].
        tol: Concavity that a part may keep [m].
        most: Largest number of parts.
        time_s: Limit of processor time [s], so that the load of the machine changes nothing.
        cache_dir: Folder of cached results.
    """
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int32)
    if len(faces) > MAX_FACES:
        return None
    key = hashlib.sha256(
        f"{VERSION} {tol:.6f} {most} ".encode() + vertices.round(7).tobytes() + faces.tobytes()
    ).hexdigest()
    kept = None if cache_dir is None else cache_dir / "decompositions" / f"{key}.npz"
    if kept is not None and kept.is_file():
        touch(kept)
        return _load(kept)
    with tempfile.TemporaryDirectory(prefix="articulate-") as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(source, vertices=vertices, faces=faces)
        command = [sys.executable, "-m", "articulate.geometry.convex_decomposition"]
        command += [str(source), str(target), f"{tol:.6f}", str(most), str(math.ceil(time_s))]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
        try:
            done = subprocess.run(  # this module, a list of arguments
                command,
                timeout=PATIENCE * time_s,
                capture_output=True,
                env=environment,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return None
        if done.returncode != 0 or not target.is_file():
            return None
        if kept is not None:
            with atomic_write(kept) as temporary:
                temporary.write_bytes(target.read_bytes())
        return _load(target)


def _load(path: Path) -> list[Array] | None:
    with np.load(path, allow_pickle=False) as content:
        parts = [content[name] for name in sorted(content.files)]
    return parts or None


def _run(source: Path, target: Path, tol: float, most: int, time_s: int) -> None:
    import coacd  # heavy and native: only in the child process

    used = math.ceil(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
    resource.setrlimit(resource.RLIMIT_CPU, (used + time_s, used + time_s + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with np.load(source, allow_pickle=False) as content:
        mesh = coacd.Mesh(content["vertices"], content["faces"])
    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        mesh,
        threshold=tol,
        max_convex_hull=most,
        preprocess_resolution=60,
        mcts_nodes=10,
        mcts_iterations=60,
        mcts_max_depth=2,
        max_ch_vertex=32,
        seed=0,
        real_metric=True,
    )
    named = {f"part_{i:03d}": np.asarray(vertices) for i, (vertices, _) in enumerate(parts)}
    np.savez(target, **named)  # type: ignore[arg-type]  # keywords are arrays


if __name__ == "__main__":
    end_with_parent()
    numbers = float(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5])
    _run(Path(sys.argv[1]), Path(sys.argv[2]), *numbers)
