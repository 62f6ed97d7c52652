"""Children: a module run in processes of its own, several side by side, each with a time limit.

What a child is asked is JSON on its standard input; what it answers stands on its standard output.
A child that crashes or hangs costs its own request; it is ended with all that it started.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar

THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of every child: more threads fight with the children beside it."""
MOST_LETTERS = 300
"""Letters that are kept of a child's last words."""

Asked = TypeVar("Asked")
Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What became of a child."""

    code: int | None
    """Its exit status, below 0 the signal that ended it; None: it took too long."""
    told: str
    """What it wrote to its standard output."""
    complained: str
    """What it wrote to its standard error."""

    @property
    def last_words(self) -> str:
        """The last line it complained of."""
        return (self.complained.strip().splitlines() or ["it said nothing"])[-1][:MOST_LETTERS]

    @property
    def signal_name(self) -> str:
        """The signal that ended it; empty if none did."""
        return "" if self.code is None or self.code >= 0 else signal.Signals(-self.code).name


class ProcessPool:
    """Runs ``python -m module`` for one request after another."""

    def __init__(self, module: str, limit_s: float) -> None:
        """Nothing is started yet.

        Args:
            module: Module that children run.
            limit_s: A child that takes longer is ended [s].
        """
        self.module = module
        self.limit_s = limit_s
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def ask(self, request: Mapping[str, Any]) -> Answer:
        """What a new child makes of ``request``; may be called by several threads.

        Raises:
            KeyboardInterrupt: :meth:`stop` was called.
        """
        with self._lock:
            if self._stopped:
                raise KeyboardInterrupt
            process = subprocess.Popen(
                [sys.executable, "-m", self.module],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                env={**os.environ, **THREADS},
                start_new_session=True,
            )
            self._running.add(process)
        try:
            told, complained = process.communicate(json.dumps(request), timeout=self.limit_s)
        except subprocess.TimeoutExpired:
            return Answer(code=None, told="", complained="")
        finally:
            _end(process)
            with self._lock:
                self._running.discard(process)
        return Answer(code=process.returncode, told=told, complained=complained)

    def side_by_side(
        self, asked: Sequence[Asked], make: Callable[[Asked], Result], jobs: int
    ) -> Iterator[Result]:
        """What ``make`` gives for each of ``asked``, ``jobs`` at a time, in the order they end.

        All children are ended when the loop over it is left, by an error too.
        """
        done: queue.SimpleQueue[Future[Result]] = queue.SimpleQueue()
        with ThreadPoolExecutor(jobs) as pool:
            try:
                for one in asked:
                    pool.submit(make, one).add_done_callback(done.put)
                for _ in asked:
                    yield done.get().result()
            finally:
                self.stop()
                pool.shutdown(wait=True, cancel_futures=True)

    def stop(self) -> None:
        """End all children; none is started from now on."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                _end(process)


def _end(process: subprocess.Popen[str]) -> None:
    """End a child and what it started."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            with suppress(OSError):
                stream.close()
