"""Addresses of MuJoCo's functions and arrays, which its Python bindings do not provide.

Models keep their own arrays. Sharing the meshes of models of one size, by overwriting pointers in
``mjModel``, would gain 0.01 of ``limit_ratio`` (``benchmarks/engine.py``) and depend on its layout.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from articulate.errors import MissingError
from articulate.simulator import mujoco
from articulate.transforms import Array, Ints

SAMPLED = (
    "actuator_acc0", "actuator_biasprm", "actuator_gainprm", "actuator_length0",
    "body_inertia", "body_invweight0", "body_mass", "body_pos", "body_quat", "body_subtreemass",
    "dof_M0", "dof_armature", "dof_damping", "dof_frictionloss", "dof_invweight0", "dof_length",
    "geom_friction", "tendon_invweight0", "tendon_length0",
)  # fmt: skip
"""Arrays in which models of one size differ: sampled numbers, and what ``mj_setConst`` computes
from them."""
_BEFORE_CENTER = 4
"""Numbers of ``mjStatistic`` before its center: mean inertia, mass and size, extent."""


@cache
def library() -> ctypes.CDLL:
    """Return MuJoCo's shared library; MissingError if it is not in the folder of its wheel."""
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
    """Return the address of ``mj_step``."""
    address = ctypes.cast(library().mj_step, ctypes.c_void_p).value
    assert address is not None
    return address


def copy_model(to: mujoco.MjModel, source: mujoco.MjModel) -> None:
    """Copy ``source`` over ``to``, a model of the same sizes, without allocation."""
    library().mj_copyModel(to._address, source._address)


def sampled_arrays(model: mujoco.MjModel) -> tuple[Ints, Ints]:
    """Return the addresses of the arrays :data:`SAMPLED` of ``model`` and their lengths (F,).

    Empty arrays are left out. The last are the numbers of ``mjStatistic``, by which the solver
    decides when it has converged.
    """
    arrays = [getattr(model, name) for name in SAMPLED]
    arrays = [array for array in arrays if array.size]
    center: Array = model.stat.center
    addresses = [*(a.ctypes.data for a in arrays), center.ctypes.data - 8 * _BEFORE_CENTER]
    sizes = [*(a.size for a in arrays), _BEFORE_CENTER + center.size]
    return np.array(addresses, dtype=np.int64), np.array(sizes, dtype=np.int64)
