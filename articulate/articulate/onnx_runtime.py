"""ONNX Runtime without telemetry: ``from articulate.onnx_runtime import onnxruntime``.

By default the library writes a device identifier, a database and a session file to the cache and
temporary folders of the user, and sends events. The environment variable has to be set before the
import; ``disable_telemetry_events`` does not prevent the files.
"""

from __future__ import annotations

import os

os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime

onnxruntime.disable_telemetry_events()

__all__ = ["onnxruntime"]
