"""MuJoCo's own library and structures by address: what its Python bindings leave out."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from articulate.errors import MissingError
from articulate.simulator import mujoco
from articulate.transforms import Array, Ints

SHARED = ("mesh_", "bvh_", "oct_", "hfield_", "tex_", "skin_")
"""Beginnings of the names of arrays that no environment changes: shapes and what is seen of them.
They are most of a model's bytes."""
DRAWN = (
    "actuator_acc0", "actuator_biasprm", "actuator_gainprm", "actuator_length0",
    "body_inertia", "body_invweight0", "body_mass", "body_pos", "body_quat", "body_subtreemass",
    "dof_M0", "dof_armature", "dof_damping", "dof_frictionloss", "dof_invweight0", "dof_length",
    "geom_friction", "tendon_invweight0", "tendon_length0",
)  # fmt: skip
"""Arrays in which models of one size differ by what is drawn: what draws write, and what
``mj_setConst`` computes from that."""
_WORDS = 600
"""So much of ``mjModel`` is looked at [8 bytes]: less than it has, more than up to those arrays."""

_BEFORE_CENTER = 4
"""Numbers of ``mjStatistic`` before its last, the center: mean inertia, mass and size, extent."""


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


def drawn_arrays(model: mujoco.MjModel) -> tuple[Ints, Ints]:
    """Addresses of the arrays :data:`DRAWN` of ``model`` and how many numbers each has (F,).

    Empty ones are left out. The last are the numbers of ``mjStatistic``, by which the solver
    measures when it is done.
    """
    arrays = [getattr(model, name) for name in DRAWN]
    arrays = [array for array in arrays if array.size]
    center: Array = model.stat.center
    addresses = [*(a.ctypes.data for a in arrays), center.ctypes.data - 8 * _BEFORE_CENTER]
    sizes = [*(a.size for a in arrays), _BEFORE_CENTER + center.size]
    return np.array(addresses, dtype=np.int64), np.array(sizes, dtype=np.int64)


class SharedModelArrays:
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
