"""Recordings of ``deploy --out``, read for reports, replays and conversions."""

from __future__ import annotations

import io
import json
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import UsageError
from articulate.transforms import Array
from articulate.untrusted import parse_json_object, read_bounded
from articulate_deploy.episode_log import read_log
from articulate_deploy.recording import EPISODES_FILE, REPORT_FILE

MAX_BYTES = 64 << 20
"""Largest file of a recording [bytes]."""
REQUIRED = ("time_s", "action", "target", "joint_pos", "joint_vel", "gripper_width_m")
"""Arrays that every recording has."""
_NAME = re.compile(r"episode_(\d{4,})\.(npz|log)")


@dataclass(frozen=True)
class RecordedEpisode:
    """One episode of a recording."""

    index: int
    arrays: dict[str, Array]
    """Arrays (T, ...) with one row for each control step."""
    result: dict[str, Any]
    """Line of ``episodes.jsonl``; empty for an episode that did not end."""


@dataclass(frozen=True)
class RecordedDeployment:
    """Folder of ``deploy --out``."""

    folder: Path
    report: dict[str, Any]
    """Content of ``report.json``; empty if the process was killed."""
    episodes: tuple[RecordedEpisode, ...]

    def episode(self, index: int) -> RecordedEpisode:
        """Return the episode with that number.

        Raises:
            UsageError: There is none.
        """
        for episode in self.episodes:
            if episode.index == index:
                return episode
        known = ", ".join(str(episode.index) for episode in self.episodes[:10])
        raise UsageError(f"{self.folder}: no episode {index}; it has {known}")


def read_deployment(folder: Path) -> RecordedDeployment:
    """Return the recording in ``folder``; a deployment that was killed has its episodes only.

    Raises:
        UsageError: It is no recording, or a file of it cannot be read.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such recording; deploy --out makes one")
    files = sorted((m, p) for p in folder.iterdir() if (m := _index(p)) is not None)
    if not files:
        raise UsageError(f"{folder}: no recording, it has no episode; deploy --out makes one")
    report: dict[str, Any] = {}
    path = folder / REPORT_FILE
    if path.exists():
        text = read_bounded(path, MAX_BYTES, error=UsageError).decode("utf-8", "replace")
        report = parse_json_object(text, str(path), error=UsageError)
    results = _results(folder / EPISODES_FILE)
    episodes = tuple(
        RecordedEpisode(index, _arrays(path), results[index] if index < len(results) else {})
        for index, path in files
    )
    return RecordedDeployment(folder, report, episodes)


def _index(path: Path) -> int | None:
    match = _NAME.fullmatch(path.name)
    return None if match is None else int(match[1])


def _results(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    lines = read_bounded(path, MAX_BYTES, error=UsageError).decode("utf-8", "replace").splitlines()
    try:
        return [dict(json.loads(line)) for line in lines]
    except (ValueError, TypeError):
        raise UsageError(f"{path}: not the results of a deployment") from None


def _arrays(path: Path) -> dict[str, Array]:
    if path.suffix == ".log":
        arrays = read_log(path)
    else:
        content = read_bounded(path, MAX_BYTES, error=UsageError)
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as stored:
                arrays = {name: np.asarray(stored[name], dtype=np.float64) for name in stored.files}
        except (OSError, ValueError, KeyError, EOFError, ImportError, zipfile.BadZipFile):
            raise UsageError(f"{path}: not an episode of a recording") from None
    missing = [name for name in REQUIRED if name not in arrays]
    if missing or len({len(values) for values in arrays.values()}) > 1:
        raise UsageError(f"{path}: not an episode of a recording")
    return arrays
