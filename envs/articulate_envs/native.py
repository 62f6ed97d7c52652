"""MuJoCo's own library and structures by address: what its Python bindings leave out."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from articulate.errors import MissingError
from articulate.simulator import mujoco
from articulate.transforms import Ints

SHARED = ("mesh_", "bvh_", "oct_", "hfield_", "tex_", "skin_")
"""Beginnings of the names of arrays that no environment changes: shapes and what is seen of them.
They are most of a model's bytes."""
_WORDS = 600
"""So much of ``mjModel`` is looked at [8 bytes]: less than it has, more than up to those arrays."""


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


class Lender:
    """A model whose arrays :data:`SHARED` others of the same sizes may use instead of their own.

    Environments are stepped in turn, and what each of them reads has to come into the cache of a
    core again and again: the less of it is its own, the faster. A model keeps the memory of its own
    arrays, and gets them back when something is copied over it; Python's views go on showing those,
    which hold the same numbers. The lender has to live as long as those that borrow, and nobody may
    write into what is shared.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Look for the pointers to the arrays of ``model``; what is not found is not shared."""
        self.model = model
        """The model that lends."""
        words = _words(model)
        found: dict[int, int] = {}
        for name in _shared_names(model):
            address = getattr(model, name).ctypes.data
            found |= {int(k): address for k in np.flatnonzero(words == address)}
        self._where = np.array(sorted(found), dtype=np.int64)
        self._addresses = np.array([found[k] for k in sorted(found)], dtype=np.int64)

    def lend(self, to: mujoco.MjModel) -> None:
        """Let ``to``, of the same sizes, use the arrays of the lender from now on."""
        _words(to)[self._where] = self._addresses


def _words(model: mujoco.MjModel) -> Ints:
    """The beginning of ``mjModel`` as it lies in memory."""
    words = (ctypes.c_int64 * _WORDS).from_address(model._address)
    return np.asarray(np.ctypeslib.as_array(words), dtype=np.int64)


def _shared_names(model: mujoco.MjModel) -> list[str]:
    """Names of the arrays of ``model`` that are shared and not empty."""
    names = [name for name in dir(model) if name.startswith(SHARED)]
    return [name for name in names if np.size(getattr(model, name)) > 0]
