"""Recordings of ``deploy --out``, read for reports, replays and conversions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import UsageError
from articulate.npz_file import read_npz
from articulate.task.observation import ACTION
from articulate.transforms import Array
from articulate.untrusted import parse_json_object, read_bounded
from articulate_deploy.episode_log import read_log
from articulate_deploy.recording import EPISODES_FILE, REPORT_FILE

MAX_BYTES = 64 << 20
"""Largest file of a recording [bytes]."""
REQUIRED: dict[str, tuple[int, ...]] = {
    "time_s": (),
    "action": (ACTION.size,),
    "target": (7,),
    "joint_pos": (7,),
    "joint_vel": (7,),
    "gripper_width_m": (),
}
"""Arrays that every recording has, with the shape of a row."""
OPTIONAL: dict[str, tuple[int, ...]] = {
    "measured_force_n": (3,),
    "policy_s": (),
    "part_open": (),
    "estimate_open": (),
}
"""Arrays that some recordings have, with the shape of a row."""
MAX_VALUE = 1e4
"""Upper bound of the numbers in required arrays; NaN is rejected as well."""
MAX_TEXT = 200
"""Longest text of ``report.json`` [characters]."""
TEXTS = ("robot", "bundle", "bundle_sha256")
"""Texts of ``report.json`` that are used."""
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
        _check_report(report, path)
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
    return [parse_json_object(line, f"{path}:{k}") for k, line in enumerate(lines, 1)]


def _check_report(report: dict[str, Any], path: Path) -> None:
    """Raise UsageError unless the values that are used have their types."""
    sender = report.get("sender", {})
    if not isinstance(sender, dict) or not all(
        isinstance(value, (int, float, str)) for value in sender.values()
    ):
        raise UsageError(f"{path}: not the report of a deployment")
    texts = [report.get(name, "") for name in TEXTS] + [str(v) for v in sender.values()]
    if not all(isinstance(text, str) and len(text) <= MAX_TEXT for text in [*texts, *sender]):
        raise UsageError(f"{path}: not the report of a deployment")


def _arrays(path: Path) -> dict[str, Array]:
    if path.suffix == ".log":
        arrays = read_log(path)
    else:
        content = read_bounded(path, MAX_BYTES, error=UsageError)
        try:
            arrays = {
                name: np.asarray(values, dtype=np.float64)
                for name, values in read_npz(content, MAX_BYTES).items()
            }
        except ValueError:
            raise UsageError(f"{path}: not an episode of a recording") from None
    shapes = {name: values.shape[1:] for name, values in arrays.items()}
    expected = REQUIRED | {name: shape for name, shape in OPTIONAL.items() if name in shapes}
    lengths = {values.shape[:1] for values in arrays.values()}
    known = {name: shapes.get(name) for name in expected}
    if (
        known != expected
        or len(lengths) != 1
        or lengths <= {(), (0,)}
        or not all((np.abs(arrays[name]) < MAX_VALUE).all() for name in REQUIRED)
    ):
        raise UsageError(f"{path}: not an episode of a recording")
    return arrays
