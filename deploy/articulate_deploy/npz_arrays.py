"""Tables of numbers in the npz files of a bundle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from articulate.errors import BundleError
from articulate.npz_file import read_npz
from articulate.transforms import Array
from articulate_deploy.bundle_files import MAX_BYTES

_FLOATS = (np.dtype("<f4"), np.dtype("<f8"))


def read_tables(
    content: bytes, shapes: Mapping[str, tuple[int, int]], where: str, expected: str
) -> dict[str, Array]:
    """Return arrays of an npz file by name, as float64.

    Args:
        content: The file.
        shapes: Names and shapes of the arrays to read.
        where: Name of the file, for messages.
        expected: Description of the content, for messages.

    Raises:
        BundleError: It is not an npz file, too large, or lacks an array of that shape.
    """
    try:
        arrays = read_npz(content, MAX_BYTES)
        tables = {name: arrays[name] for name in shapes}
    except (ValueError, KeyError):
        tables = {}
    if len(tables) < len(shapes) or any(
        tables[name].shape != shape or tables[name].dtype not in _FLOATS
        for name, shape in shapes.items()
    ):
        raise BundleError(f"{where}: does not hold {expected}")
    return {name: np.array(table, dtype=np.float64, order="C") for name, table in tables.items()}
