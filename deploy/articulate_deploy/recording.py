"""Recordings on disk: one file of arrays and one line of JSON for each episode.

``episode_0000.npz`` has arrays with one row a control step, ``episodes.jsonl`` the result and the
parameters of each episode, and ``report.json`` the report. ``np.load(path, allow_pickle=False)``
reads the arrays. During an episode it is ``episode_0000.log``
(:mod:`articulate_deploy.episode_log`), which stays if the process is killed.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np

from articulate.errors import UsageError
from articulate.files import atomic_write, write_json, write_text
from articulate_deploy.episode import Recording
from articulate_deploy.episode_log import EpisodeLog
from articulate_deploy.report import DeployReport

EPISODES_FILE, REPORT_FILE = "episodes.jsonl", "report.json"
EPISODE = re.compile(r"episode_\d{4,}\.npz|\.episode_\d{4,}\.npz\..*")
"""Name of an episode, or of its temporary file."""
NOT_EMPTY = "exists and is not empty; choose another --out"


@contextmanager
def claimed_folders(folders: Sequence[Path]) -> Iterator[None]:
    """Make the folders of recordings, or none, and hold them while the block runs.

    The claim is an empty, locked ``episodes.jsonl``, which :func:`write_report` replaces. A killed
    process loses its lock, so that its incomplete recording can be replaced.

    Raises:
        UsageError: A folder holds something else, is in use or cannot be made.
    """
    with ExitStack() as stack:
        for folder in folders:
            stack.enter_context(_claimed(folder))
        yield


@contextmanager
def _claimed(folder: Path) -> Iterator[None]:
    """Hold one folder; if no episode is recorded, everything made here is removed again."""
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        earlier = [path for path in folder.iterdir() if path.name != EPISODES_FILE]
        if any(not EPISODE.fullmatch(path.name) for path in earlier):
            raise UsageError(f"{folder}: {NOT_EMPTY}")
        claim = folder / EPISODES_FILE
        if earlier and not claim.exists():
            raise UsageError(f"{folder}: {NOT_EMPTY}")
        handle = os.open(claim, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise UsageError(
            f"{folder}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    with os.fdopen(handle):
        _lock(handle, claim)
        for path in earlier:  # of a killed process
            path.unlink()
        try:
            yield
        finally:
            if [path.name for path in folder.iterdir()] == [EPISODES_FILE]:
                claim.unlink()
                with suppress(OSError):  # others may use the folders above
                    for path in new:
                        path.rmdir()


def _lock(handle: int, claim: Path) -> None:
    """Lock the claim, unless another process holds it or has written its report there."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UsageError(
            f"{claim.parent}: in use by another process; choose another --out"
        ) from None
    state = os.fstat(handle)
    if state.st_size > 0 or state.st_ino != claim.stat().st_ino:
        raise UsageError(f"{claim.parent}: {NOT_EMPTY}")


def write_episode(folder: Path, index: int, recording: Recording) -> Path:
    """Write the arrays of one episode, completely or not at all."""
    path = folder / f"episode_{index:04d}.npz"
    with atomic_write(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **recording.arrays())  # type: ignore[arg-type]
    return path


def finish_episode(log: EpisodeLog) -> Path:
    """Replace the log of a complete episode by its arrays."""
    log.close()
    path = write_episode(log.folder, log.index, log)
    log.path.unlink()
    return path


def write_report(folder: Path, report: DeployReport) -> None:
    """Write ``episodes.jsonl`` and ``report.json``."""
    content = report.as_dict()
    lines = [json.dumps(episode, allow_nan=False) for episode in content["each"]]
    write_text(folder / EPISODES_FILE, "".join(f"{line}\n" for line in lines))
    write_json(folder / REPORT_FILE, content)
