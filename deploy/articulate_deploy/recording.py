"""Recordings on disk: one file of arrays per episode, and a line about each.

``episode_0000.npz`` holds arrays with one row per tick, ``episodes.jsonl`` how each ended and
what was drawn; ``report.json`` the whole. ``np.load(path, allow_pickle=False)`` reads them.
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


def new_folder(folder: Path) -> None:
    """Make the folder of a recording, and claim it: of several at once one gets it.

    The claim is an empty ``episodes.jsonl``, which :func:`write_report` replaces.

    Raises:
        UsageError: It exists and holds something, or cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not any(folder.iterdir()):
            (folder / EPISODES_FILE).touch(exist_ok=False)
            return
    except FileExistsError as error:
        if not folder.is_dir():  # something that is no folder stands there
            raise _not_written(folder, error) from None
    except OSError as error:
        raise _not_written(folder, error) from None
    raise UsageError(f"{folder}: exists and is not empty; choose another --out")


def _not_written(folder: Path, error: OSError) -> UsageError:
    return UsageError(f"{folder}: cannot be written ({error.strerror}); choose another --out")


def new_folders(folders: Sequence[Path]) -> None:
    """Make and claim all of ``folders``, or none.

    Raises:
        UsageError: As :func:`new_folder`.
    """
    for k, folder in enumerate(folders):
        try:
            new_folder(folder)
        except UsageError:
            give_back(folders[:k])
            raise


def give_back(folders: Sequence[Path]) -> None:
    """Take the claims back where nothing was recorded, so that the folders can be used again."""
    for folder in folders:
        if [path.name for path in folder.iterdir()] == [EPISODES_FILE]:
            (folder / EPISODES_FILE).unlink()


def write_episode(folder: Path, index: int, recording: Recording) -> Path:
    """Write the arrays of one episode, whole or not at all."""
    path = folder / f"episode_{index:04d}.npz"
    with atomic_write(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **recording.arrays())  # type: ignore[arg-type]  # names are ours
    return path


def write_report(folder: Path, report: DeployReport) -> None:
    """Write ``episodes.jsonl`` and ``report.json``."""
    content = report.as_dict()
    lines = [json.dumps(episode, allow_nan=False) for episode in content["each"]]
    write_text(folder / EPISODES_FILE, "".join(f"{line}\n" for line in lines))
    write_json(folder / REPORT_FILE, content)
