"""Recordings on disk: one file of arrays and one line of JSON for each episode.

``episode_0000.npz`` has arrays with one row a control step, ``episodes.jsonl`` the result and the
parameters of each episode, and ``report.json`` the report. ``np.load(path, allow_pickle=False)``
reads the arrays.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from articulate.errors import UsageError
from articulate.files import atomic_write, write_json, write_text
from articulate_deploy.episode import Recording
from articulate_deploy.report import DeployReport

EPISODES_FILE, REPORT_FILE = "episodes.jsonl", "report.json"


def claim_folder(folder: Path) -> None:
    """Make the folder of a recording and claim it: of several processes one gets it.

    The claim is an empty ``episodes.jsonl``, which :func:`write_report` replaces.

    Raises:
        UsageError: It is not empty or cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not any(folder.iterdir()):
            (folder / EPISODES_FILE).touch(exist_ok=False)
            return
    except FileExistsError as error:
        if not folder.is_dir():
            raise _write_error(folder, error) from None
    except OSError as error:
        raise _write_error(folder, error) from None
    raise UsageError(f"{folder}: exists and is not empty; choose another --out")


def _write_error(folder: Path, error: OSError) -> UsageError:
    return UsageError(f"{folder}: cannot be written ({error.strerror}); choose another --out")


def claim_folders(folders: Sequence[Path]) -> None:
    """Make and claim all of ``folders``, or none.

    Raises:
        UsageError: As :func:`claim_folder`.
    """
    for k, folder in enumerate(folders):
        try:
            claim_folder(folder)
        except UsageError:
            release_folders(folders[:k])
            raise


def release_folders(folders: Sequence[Path]) -> None:
    """Remove the claims of folders without a recording, so that they can be used again."""
    for folder in folders:
        if [path.name for path in folder.iterdir()] == [EPISODES_FILE]:
            (folder / EPISODES_FILE).unlink()


def write_episode(folder: Path, index: int, recording: Recording) -> Path:
    """Write the arrays of one episode, completely or not at all."""
    path = folder / f"episode_{index:04d}.npz"
    with atomic_write(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **recording.arrays())  # type: ignore[arg-type]
    return path


def write_report(folder: Path, report: DeployReport) -> None:
    """Write ``episodes.jsonl`` and ``report.json``."""
    content = report.as_dict()
    lines = [json.dumps(episode, allow_nan=False) for episode in content["each"]]
    write_text(folder / EPISODES_FILE, "".join(f"{line}\n" for line in lines))
    write_json(folder / REPORT_FILE, content)
