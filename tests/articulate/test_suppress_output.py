import os
import subprocess
import sys
from pathlib import Path

import pytest

from articulate.suppress_output import suppress_output

CODE = """
import ctypes
from articulate.suppress_output import suppress_output
libc = ctypes.CDLL(None)
print("before")
with suppress_output():
    libc.puts(b"from below")
    print("from Python", flush=True)
print("after", flush=True)
"""


def test_what_is_printed_below_python_is_not_heard_and_the_rest_is():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert done.stdout == "before\nafter\n"
    assert done.stderr == ""


def open_descriptors():
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.is_dir() else 0


def test_the_streams_are_given_back_after_an_error(capfd):
    opened = open_descriptors()
    with pytest.raises(ValueError, match="inside"), suppress_output():
        raise ValueError("inside")
    os.write(1, b"heard")
    assert capfd.readouterr().out == "heard"
    assert open_descriptors() == opened
