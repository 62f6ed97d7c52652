"""Tables of numbers in npz files, read within bounds.

Only what ``numpy.savez`` writes of such a table is taken, and its header is compared with what
is expected before any number is looked at: a header may claim any size, and is text that
:func:`numpy.load` evaluates.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Mapping

import numpy as np

from articulate.errors import BundleError
from articulate.transforms import Array
from articulate_deploy.bundle_files import MAX_BYTES, UNREADABLE, member

_MAGIC = b"\x93NUMPY\x01\x00"
_HEADER = re.compile(
    rb"\{'descr': '(<f[48])', 'fortran_order': (True|False), "
    rb"'shape': \((\d{1,9}), (\d{1,9})\), \} *\n"
)


def read_tables(
    content: bytes, shapes: Mapping[str, tuple[int, int]], where: str, wanted: str
) -> dict[str, Array]:
    """Tables of an npz file by name, as float64.

    Args:
        content: The file.
        shapes: Names of the tables that are wanted, and their shapes.
        where: Where it comes from, for messages.
        wanted: What it is to hold, for messages.

    Raises:
        BundleError: It is no such file, too large, or lacks a table of that shape.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(item.file_size for item in archive.infolist()) > MAX_BYTES:
                raise BundleError(f"{where}: larger than a bundle may be")
            return {
                name: _table(member(archive, archive.getinfo(f"{name}.npy")), shape)
                for name, shape in shapes.items()
            }
    except UNREADABLE:
        raise BundleError(f"{where}: does not hold {wanted}") from None


def _table(content: bytes, shape: tuple[int, int]) -> Array:
    """The table that an npy file holds; ValueError if it is none of that shape."""
    begin = len(_MAGIC) + 2
    end = begin + int.from_bytes(content[len(_MAGIC) : begin], "little")
    header = _HEADER.fullmatch(content[begin:end])
    if not content.startswith(_MAGIC) or header is None:
        raise ValueError("not a table of numbers")
    if (int(header[3]), int(header[4])) != shape:
        raise ValueError("another shape")
    numbers = np.frombuffer(content, dtype=header[1].decode("ascii"), offset=end)
    by_columns = header[2] == b"True"
    table = numbers.reshape(shape[::-1]).T if by_columns else numbers.reshape(shape)
    return np.array(table, dtype=np.float64, order="C")
