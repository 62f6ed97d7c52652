"""The policy of a bundle: observations in, actions out, on one thread."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from articulate.errors import BundleError, shorten
from articulate.onnx_runtime import onnxruntime
from articulate.transforms import Array
from articulate_deploy.bundle import Bundle
from articulate_deploy.npz_arrays import read_tables

MAX_GOLDEN_S = 2.0
"""Longest time for the golden pairs [s]; a typical policy takes a millisecond. The time of a plain
graph does not depend on its inputs, so later calls need no limit."""


class Policy:
    """ONNX graph that has reproduced its golden pairs."""

    def __init__(self, bundle: Bundle) -> None:
        """Load and check the policy.

        Raises:
            BundleError: It cannot be read, or does not reproduce its golden pairs.
        """
        manifest, where = bundle.manifest, f"{bundle.where}/{bundle.manifest.policy.file}"
        self._entry, self._where = manifest.policy, where
        self._actions = manifest.action.size
        self._session = _session(bundle.policy, where)
        sizes = (manifest.observation.size, manifest.action.size)
        _check_ends(self._session, manifest.policy.input, manifest.policy.output, sizes, where)
        observation, expected = _golden(bundle)
        options = onnxruntime.RunOptions()
        with _stopped_after(options, MAX_GOLDEN_S):
            self._act(observation[:1], options)  # robots use one row, which must work too
            action = self._act(observation, options)
        error = float(np.max(np.abs(action - expected)))
        if not error <= manifest.golden.atol:
            raise BundleError(
                f"{where}: differs from its golden pairs by {error:.2g} where "
                f"{manifest.golden.atol:.2g} is allowed; export it again"
            )

    def act(self, observation: Array) -> Array:
        """Return actions (N, 8) in [-1, 1] for observations (N, size).

        Raises:
            BundleError: The network fails, or its output has another shape or is not finite.
        """
        return self._act(observation, None)

    def _act(self, observation: Array, options: onnxruntime.RunOptions | None) -> Array:
        feed = {self._entry.input: np.ascontiguousarray(observation, dtype=np.float32)}
        try:
            out = np.asarray(
                self._session.run([self._entry.output], feed, options)[0], dtype=np.float64
            )
        except Exception as error:  # noqa: BLE001  no common base class
            raise _cannot_run(self._where, error) from None
        if out.shape != (len(observation), self._actions):
            raise BundleError(
                f"{self._where}: its output has the shape {out.shape} for {len(observation)} "
                "observations; export it again"
            )
        if not np.isfinite(out).all():
            raise BundleError(f"{self._where}: an action is not finite; export it again")
        return np.clip(out, -1.0, 1.0)


@contextmanager
def _stopped_after(options: onnxruntime.RunOptions, seconds: float) -> Iterator[None]:
    """Terminate calls with these options after ``seconds``; they raise an error then."""
    timer = threading.Timer(seconds, setattr, (options, "terminate", True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _cannot_run(where: str, error: Exception) -> BundleError:
    return BundleError(f"{where}: cannot be run ({shorten(error, 160)})")


def _session(content: bytes, where: str) -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.load_model_format", "ONNX")  # as it was checked
    options.log_severity_level = 4  # errors are raised
    try:
        return onnxruntime.InferenceSession(
            content,
            options,
            providers=["CPUExecutionProvider"],
            disabled_optimizers=["ConstantFolding"],  # it cannot be terminated
        )
    except Exception as error:  # noqa: BLE001  no common base class
        raise _cannot_run(where, error) from None


def _check_ends(
    session: Any, name_in: str, name_out: str, sizes: tuple[int, int], where: str
) -> None:
    ends = [(e.name, e.type, e.shape) for e in [*session.get_inputs(), *session.get_outputs()]]
    fits = len(ends) == 2 and all(
        name == expected and kind == "tensor(float)" and len(shape) == 2 and shape[1] == size
        for (name, kind, shape), expected, size in zip(
            ends, (name_in, name_out), sizes, strict=False
        )
    )
    if not fits:
        raise BundleError(f"{where}: its input and output are not those of the manifest")


def _golden(bundle: Bundle) -> tuple[Array, Array]:
    manifest, count = bundle.manifest, bundle.manifest.golden.count
    where = f"{bundle.where}/{manifest.golden.file}"
    expected = f"{count} pairs of the manifest's sizes"
    if count < 1:
        raise BundleError(f"{where}: does not hold {expected}")
    shapes = {
        "observation": (count, manifest.observation.size),
        "action": (count, manifest.action.size),
    }
    pairs = read_tables(bundle.golden, shapes, where, expected)
    return pairs["observation"], pairs["action"]
