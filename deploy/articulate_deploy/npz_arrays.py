"""Arrays of numbers in npz files, read within bounds.

Only arrays as ``numpy.savez`` writes them are read, and their headers are compared with the
expected shapes first: a header may claim any size, and :func:`numpy.load` evaluates its text.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from articulate.errors import BundleError
from articulate.transforms import Array
from articulate_deploy.bundle_files import MAX_BYTES, UNREADABLE, member, open_zip

_MAGIC = b"\x93NUMPY\x01\x00"
_HEADER = re.compile(
    rb"\{'descr': '(<f[48])', 'fortran_order': (True|False), "
    rb"'shape': \((\d{1,9}), (\d{1,9})\), \} *\n"
)


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
        with open_zip(content) as archive:
            if sum(item.file_size for item in archive.infolist()) > MAX_BYTES:
                raise BundleError(f"{where}: larger than a bundle may be")
            return {
                name: _table(member(archive, archive.getinfo(f"{name}.npy")), shape)
                for name, shape in shapes.items()
            }
    except UNREADABLE:
        raise BundleError(f"{where}: does not hold {expected}") from None


def _table(content: bytes, shape: tuple[int, int]) -> Array:
    """Return the array of an npy file.

    Raises:
        ValueError: It is not an array of floats of this shape.
    """
    begin = len(_MAGIC) + 2
    end = begin + int.from_bytes(content[len(_MAGIC) : begin], "little")
    header = _HEADER.fullmatch(content[begin:end])
    if not content.startswith(_MAGIC) or header is None:
        raise ValueError("not an array of floats")
    if (int(header[3]), int(header[4])) != shape:
        raise ValueError("another shape")
    numbers = np.frombuffer(content, dtype=header[1].decode("ascii"), offset=end)
    by_columns = header[2] == b"True"
    table = numbers.reshape(shape[::-1]).T if by_columns else numbers.reshape(shape)
    return np.array(table, dtype=np.float64, order="C")
