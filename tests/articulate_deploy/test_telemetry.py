"""ONNX Runtime writes nothing to the disk of the user and opens no connection."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import numpy as np
from onnx import helper, numpy_helper
from articulate.onnx_runtime import onnxruntime
x, y = (helper.make_tensor_value_info(n, 1, ["batch", 2]) for n in "xy")
w = numpy_helper.from_array(np.eye(2, dtype=np.float32), "w")
graph = helper.make_graph([helper.make_node("MatMul", ["x", "w"], ["y"])], "g", [x], [y], [w])
model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=8)
session = onnxruntime.InferenceSession(model.SerializeToString())
session.run(None, {"x": np.ones((1, 2), dtype=np.float32)})
"""


def test_a_session_leaves_no_file_in_home_and_temporary_folder(tmp_path):
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("ORT_", "XDG_"))}
    environment |= {"HOME": str(tmp_path), "TMPDIR": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run([sys.executable, "-c", CODE], env=environment, check=True, cwd=tmp_path)
    assert list(tmp_path.rglob("*")) == []


@pytest.mark.slow  # the first event would be sent after some seconds
@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_a_session_opens_no_socket_of_the_internet(tmp_path):
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("ORT_", "XDG_"))}
    environment |= {"HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    session = Path("/tmp/.ses")  # whatever TMPDIR is
    before = session.stat().st_mtime_ns if session.exists() else None
    trace, code = tmp_path / "trace", f"{CODE}\nimport time; time.sleep(20)"
    command = [
        "strace",
        "-f",
        "-e",
        "trace=socket,connect",
        "-o",
        trace,
        sys.executable,
        "-c",
        code,
    ]
    subprocess.run(command, env=environment, check=True, cwd=tmp_path)
    assert "AF_INET" not in trace.read_text()
    assert (session.stat().st_mtime_ns if session.exists() else None) == before
