"""Compilation of row functions by numba, with a cache that depends on their sources."""

from __future__ import annotations

import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.extending import register_jitable

from articulate.jit import ROW_FUNCTIONS

OPTIONS: dict[str, Any] = {"error_model": "numpy", "boundscheck": False}
INLINED: dict[str, Any] = {**OPTIONS, "forceinline": True}
"""Options of row functions. A call that is not inlined copies all arrays of its named tuples: 45 of
390 us in a control step."""
_registered: dict[Callable[..., Any], None] = {}


def register_row_functions() -> None:
    """Let compiled functions call all row functions that are imported."""
    for function in ROW_FUNCTIONS:
        if function not in _registered:
            register_jitable(**INLINED)(function)
            _registered[function] = None


def source_version() -> int:
    """Return a checksum of the sources of all row functions and of numba's interface to them.

    numba's cache on disk depends on the file of the outermost function only. The checksum makes
    it depend on all of them.
    """
    modules = {sys.modules[function.__module__].__file__ for function in ROW_FUNCTIONS}
    files = sorted(Path(file) for file in modules | {__file__} if file)
    return zlib.crc32(b"".join(file.read_bytes() for file in files))


def entry_point(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a compiled function that calls the row function ``function`` without the GIL."""
    register_row_functions()
    version = source_version()

    @njit(nogil=True, cache=True, **OPTIONS)  # type: ignore[untyped-decorator]  # numba's
    def call(*args: Any) -> Any:
        _ = version  # a closure variable, so a part of the cache key
        return function(*args)

    compiled: Callable[..., Any] = call
    return compiled
