"""The policy of a bundle: observations in, actions out, on one thread."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np
import onnxruntime

from articulate.errors import BundleError
from articulate.transforms import Array
from articulate_deploy.bundle import MAX_BYTES, Bundle


class Policy:
    """An ONNX graph that gave its golden pairs when it was loaded."""

    def __init__(self, bundle: Bundle) -> None:
        """Load and check the policy.

        Raises:
            BundleError: It cannot be read, or does not give its golden pairs.
        """
        manifest, where = bundle.manifest, f"{bundle.where}/{bundle.manifest.policy.file}"
        self._entry = manifest.policy
        self._session = _session(bundle.policy, where)
        sizes = (manifest.observation.size, manifest.action.size)
        _check_ends(self._session, manifest.policy.input, manifest.policy.output, sizes, where)
        seen, wanted = _golden(bundle)
        error = float(np.max(np.abs(self.act(seen) - wanted)))
        if not error <= manifest.golden.atol:
            raise BundleError(
                f"{where}: differs from its golden pairs by {error:.2g} where "
                f"{manifest.golden.atol:.2g} is allowed; export it again"
            )

    def act(self, observation: Array) -> Array:
        """Actions (N, 8) in [-1, 1] for observations (N, size)."""
        feed = {self._entry.input: np.ascontiguousarray(observation, dtype=np.float32)}
        out = self._session.run([self._entry.output], feed)[0]
        return np.clip(np.asarray(out, dtype=np.float64), -1.0, 1.0)


def _session(content: bytes, where: str) -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # noqa: BLE001  its exceptions share no class that can be named
        text = (str(error).splitlines() or [""])[0][:160]
        raise BundleError(f"{where}: cannot be run ({text})") from None


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
    manifest = bundle.manifest
    where = f"{bundle.where}/{manifest.golden.file}"
    try:
        with zipfile.ZipFile(io.BytesIO(bundle.golden)) as archive:
            if sum(item.file_size for item in archive.infolist()) > MAX_BYTES:
                raise BundleError(f"{where}: larger than a bundle may be")
        with np.load(io.BytesIO(bundle.golden), allow_pickle=False) as pairs:
            seen = np.asarray(pairs["observation"], dtype=np.float32)
            wanted = np.asarray(pairs["action"], dtype=np.float64)
    except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile):
        raise BundleError(f"{where}: not a file of golden pairs") from None
    count = manifest.golden.count
    shapes = ((count, manifest.observation.size), (count, manifest.action.size))
    if count < 1 or (seen.shape, wanted.shape) != shapes:
        raise BundleError(f"{where}: does not hold {count} pairs of the manifest's sizes")
    return np.asarray(seen, dtype=np.float64), wanted
