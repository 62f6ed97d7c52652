"""The policy of a bundle: observations in, actions out, on one thread."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import onnxruntime

from articulate.errors import BundleError
from articulate.transforms import Array
from articulate_deploy.bundle import Bundle
from articulate_deploy.npz_arrays import read_tables

MOST_S = 2.0
"""Longest that the golden pairs may take [s]; ours take a millisecond. What a plain graph computes
does not depend on the numbers that it is given, so that later answers need no watch."""


class Policy:
    """An ONNX graph that gave its golden pairs when it was loaded."""

    def __init__(self, bundle: Bundle) -> None:
        """Load and check the policy.

        Raises:
            BundleError: It cannot be read, or does not give its golden pairs.
        """
        manifest, where = bundle.manifest, f"{bundle.where}/{bundle.manifest.policy.file}"
        self._entry, self._where = manifest.policy, where
        self._actions = manifest.action.size
        self._session = _session(bundle.policy, where)
        sizes = (manifest.observation.size, manifest.action.size)
        _check_ends(self._session, manifest.policy.input, manifest.policy.output, sizes, where)
        seen, wanted = _golden(bundle)
        options = onnxruntime.RunOptions()
        with _stopped_after(options, MOST_S):
            self._act(seen[:1], options)  # a network may take so many rows only; robots ask for one
            given = self._act(seen, options)
        error = float(np.max(np.abs(given - wanted)))
        if not error <= manifest.golden.atol:
            raise BundleError(
                f"{where}: differs from its golden pairs by {error:.2g} where "
                f"{manifest.golden.atol:.2g} is allowed; export it again"
            )

    def act(self, observation: Array) -> Array:
        """Actions (N, 8) in [-1, 1] for observations (N, size).

        Raises:
            BundleError: The network fails, or gives something else.
        """
        return self._act(observation, None)

    def _act(self, observation: Array, options: onnxruntime.RunOptions | None) -> Array:
        feed = {self._entry.input: np.ascontiguousarray(observation, dtype=np.float32)}
        try:
            out = np.asarray(
                self._session.run([self._entry.output], feed, options)[0], dtype=np.float64
            )
        except Exception as error:  # noqa: BLE001  its exceptions share no class that can be named
            raise _cannot_run(self._where, error) from None
        if out.shape != (len(observation), self._actions):
            raise BundleError(
                f"{self._where}: gives numbers of shape {out.shape} for {len(observation)} "
                "observations; export it again"
            )
        return np.clip(out, -1.0, 1.0)


@contextmanager
def _stopped_after(options: onnxruntime.RunOptions, seconds: float) -> Iterator[None]:
    """What runs with these options is told to stop after so long, which raises."""
    timer = threading.Timer(seconds, setattr, (options, "terminate", True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _cannot_run(where: str, error: Exception) -> BundleError:
    text = (str(error).splitlines() or [""])[0][:160]
    return BundleError(f"{where}: cannot be run ({text})")


def _session(content: bytes, where: str) -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.load_model_format", "ONNX")  # as it was checked
    options.log_severity_level = 4  # what fails is raised, and need not be printed as well
    try:
        return onnxruntime.InferenceSession(
            content,
            options,
            providers=["CPUExecutionProvider"],
            disabled_optimizers=["ConstantFolding"],  # what it computes there nobody can stop
        )
    except Exception as error:  # noqa: BLE001  its exceptions share no class that can be named
        raise _cannot_run(where, error) from None


def _check_ends(
    session: Any, name_in: str, name_out: str, sizes: tuple[int, int], where: str
) -> None:
    ends = [(e.name, e.type, e.shape) for e in [*session.get_inputs(), *session.get_outputs()]]
    fits = len(ends) == 2 and all(
        name == wanted and kind == "tensor(float)" and len(shape) == 2 and shape[1] == size
        for (name, kind, shape), wanted, size in zip(ends, (name_in, name_out), sizes, strict=False)
    )
    if not fits:
        raise BundleError(f"{where}: its input and output are not those that the manifest names")


def _golden(bundle: Bundle) -> tuple[Array, Array]:
    manifest, count = bundle.manifest, bundle.manifest.golden.count
    where, wanted = (
        f"{bundle.where}/{manifest.golden.file}",
        f"{count} pairs of the manifest's sizes",
    )
    if count < 1:
        raise BundleError(f"{where}: does not hold {wanted}")
    shapes = {
        "observation": (count, manifest.observation.size),
        "action": (count, manifest.action.size),
    }
    pairs = read_tables(bundle.golden, shapes, where, wanted)
    return pairs["observation"], pairs["action"]
