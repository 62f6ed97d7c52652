"""Check the edited object in child processes; a newer edit ends the check of an older one."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from articulate.errors import UsageError
from articulate.files import write_json
from articulate.jobs.process_identity import end_with_parent
from articulate.preparation.batch import Batch, Item
from articulate.preparation.check_report_file import load_check_report
from articulate.studio.model import StudioModel
from articulate.studio.write import write_model


@dataclass(frozen=True, kw_only=True)
class CheckState:
    """State of the check of one revision."""

    revision: int
    state: str
    """``running`` or ``done``."""
    verdict: str = ""
    reasons: tuple[str, ...] = ()
    seconds: float = 0.0
    folder: Path | None = None
    """Folder with the asset and its check report."""

    def content(self) -> dict[str, Any]:
        """Return the state for the page."""
        return {
            "revision": self.revision,
            "state": self.state,
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "seconds": round(self.seconds, 1),
        }


class Checker:
    """Checks the newest revision in the background.

    Args:
        cache: Folder of the cache for checked assets.
        limit_s: Processor time of a check [s].
        origin: Source, licence and category of the object.
    """

    def __init__(self, cache: Path, limit_s: float, origin: dict[str, str]) -> None:
        self._cache, self._limit_s, self._origin = cache, limit_s, origin
        self._work = Path(tempfile.mkdtemp(prefix="articulate-studio-"))
        self._lock = threading.Condition()
        self._process: subprocess.Popen[str] | None = None
        self._state: CheckState | None = None
        self._closed = False

    @property
    def state(self) -> CheckState | None:
        """State of the newest check; None before the first."""
        with self._lock:
            return self._state

    def start(self, model: StudioModel, revision: int) -> None:
        """Check ``model`` in the background; an earlier check that is running ends."""
        with self._lock:
            if self._closed:
                return
            self._end()
            earlier = self._state
            self._state = CheckState(revision=revision, state="running")
        if earlier is not None:
            shutil.rmtree(self._folder(earlier.revision), ignore_errors=True)
        threading.Thread(target=self._run, args=(model, revision), daemon=True).start()

    def wait(self, revision: int, seconds: float) -> CheckState | None:
        """Return the state of ``revision`` once it is done; None if it is superseded or late."""
        with self._lock:
            self._lock.wait_for(
                lambda: (
                    self._closed
                    or self._state is None
                    or self._state.revision != revision
                    or self._state.state == "done"
                ),
                seconds,
            )
            state = self._state
        done = state is not None and state.revision == revision and state.state == "done"
        return state if done else None

    def close(self) -> None:
        """End the running check and remove its files."""
        with self._lock:
            self._closed = True
            self._end()
            self._lock.notify_all()
        shutil.rmtree(self._work, ignore_errors=True)

    def _folder(self, revision: int) -> Path:
        return self._work / str(revision)

    def _run(self, model: StudioModel, revision: int) -> None:
        folder = self._folder(revision)
        try:
            source = folder / "source"
            urdf = write_model(model, source)
            write_json(source / "source.json", self._origin)
            arguments = [str(urdf), str(folder / "asset"), str(self._cache), str(self._limit_s)]
            with self._lock:
                if not self._is_newest(revision):
                    return
                self._process = process = subprocess.Popen(
                    [sys.executable, "-m", "articulate.studio.checker", str(os.getpid()),
                     *arguments],
                    stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                    text=True, errors="replace", start_new_session=True,
                )  # fmt: skip
            message = process.communicate()[1]
            done = _result(folder / "asset", revision, message)
        except (OSError, UsageError) as error:
            done = CheckState(
                revision=revision, state="done", verdict="undecided", reasons=(str(error),)
            )
        with self._lock:
            if self._is_newest(revision):
                self._state, self._process = done, None
                self._lock.notify_all()

    def _is_newest(self, revision: int) -> bool:
        return not self._closed and self._state is not None and self._state.revision == revision

    def _end(self) -> None:
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process = None


def _result(asset: Path, revision: int, message: str) -> CheckState:
    try:
        report = load_check_report(asset)
    except UsageError:
        lines = message.strip().splitlines() or ["the check left no report"]
        return CheckState(
            revision=revision, state="done", verdict="undecided", reasons=(lines[-1][:500],)
        )
    return CheckState(
        revision=revision,
        state="done",
        verdict=report.verdict,
        reasons=report.reasons,
        seconds=report.seconds,
        folder=asset,
    )


def main(argv: list[str]) -> int:
    """Check the object at ``argv[1]`` into ``argv[2]``, with cache and time limit."""
    end_with_parent(int(argv[0]))
    urdf, out, cache = (Path(word) for word in argv[1:4])
    batch = Batch(out=out, cache=cache, options={}, limit_s=float(argv[4]), single=True)
    try:
        batch.one(Item(name=urdf.stem, file=urdf))
    except UsageError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
