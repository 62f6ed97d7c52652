"""Recordings for rerun."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from articulate.errors import MissingError
from articulate.files import atomic_write
from articulate.transforms import Array


@contextmanager
def rerun_recording(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open a recording with the z axis up; ``path`` is replaced atomically at the end.

    Yields:
        The module ``rerun`` and the recording stream.

    Raises:
        MissingError: rerun-sdk is not installed.
    """
    try:
        import rerun  # heavy; imported on demand
    except ImportError:  # also of one of its modules
        raise MissingError(
            f"{path}: .rrd needs rerun-sdk, which is not installed; "
            'run: pip install "articulate-robots[watch]", or end --out in .mp4'
        ) from None
    with atomic_write(path) as temporary:
        stream = rerun.RecordingStream("articulate", send_properties=False)
        stream.save(temporary)
        stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        yield rerun, stream
        stream.flush()
        stream.disconnect()


def rerun_name(name: str) -> str:
    """Return a name as one part of an entity path, without characters that need an escape."""
    return re.sub(r"[^\w.-]", "_", name)


def rerun_pose(rerun: Any, position: Array, quaternion: Array) -> Any:
    """Return a rerun transform from a position (3,) [m] and a quaternion (4,), w first."""
    w, *xyz = quaternion
    return rerun.Transform3D(translation=position, quaternion=rerun.Quaternion(xyzw=[*xyz, w]))
