"""MuJoCo's own library by address: what its Python bindings leave out."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

from articulate.errors import MissingError
from articulate.simulator import mujoco


@cache
def library() -> ctypes.CDLL:
    """MuJoCo's shared library as it is loaded; MissingError if it is not in the wheel's place."""
    folder = Path(mujoco.__file__).parent
    patterns = ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll")
    names = sorted(path for pattern in patterns for path in folder.glob(pattern))
    if not names:
        raise MissingError(f"no MuJoCo library in {folder}; reinstall mujoco from its wheel")
    lib = ctypes.CDLL(str(names[0]))
    lib.mj_copyModel.restype = ctypes.c_void_p
    lib.mj_copyModel.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    return lib


def step_address() -> int:
    """Address of ``mj_step``."""
    address = ctypes.cast(library().mj_step, ctypes.c_void_p).value
    assert address is not None
    return address


def copy_model(to: mujoco.MjModel, source: mujoco.MjModel) -> None:
    """Write ``source`` over ``to``, which is of the same sizes, without allocating."""
    library().mj_copyModel(to._address, source._address)
