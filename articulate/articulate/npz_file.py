"""Arrays of an ``.npz`` file from an untrusted source, read within bounds.

:func:`numpy.load` allocates what a header claims and evaluates the header's text. Here a header is
matched as text, its size is compared with the size of the member, and nothing else is read.
"""

from __future__ import annotations

import io
import math
import re
import struct
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_ARRAYS = 1000
"""Most arrays of a file."""
DAMAGED = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    struct.error,
    EOFError,
    KeyError,
    MemoryError,
    OSError,
    OverflowError,
    RuntimeError,  # encrypted members and unknown compression
    TypeError,  # a number type that NumPy does not have
)
"""Errors of :mod:`zipfile` and NumPy for damaged files."""
_COMPRESSION = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
_ENTRY = b"PK\x01\x02"  # an entry in the directory of a zip file
_MAGIC = b"\x93NUMPY\x01\x00"
_HEADER = re.compile(
    rb"\{'descr': '([<>|=]?[biufU]\d{1,4})', 'fortran_order': (True|False), "
    rb"'shape': \(((?:\d{1,12}, ?)*(?:\d{1,12})?)\), \} *\n"
)


def read_npz(content: bytes, limit_bytes: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of numbers, booleans and text of an npz file by name.

    Args:
        content: The file.
        limit_bytes: Largest size of all arrays together.

    Raises:
        ValueError: It is damaged, larger, or holds something else.
    """
    try:
        if content.count(_ENTRY) > MAX_ARRAYS + 1:
            raise ValueError(f"more than {MAX_ARRAYS} arrays")
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > limit_bytes:
                raise ValueError(f"arrays larger than {limit_bytes} bytes")
            arrays = {}
            for member in members:
                if member.flag_bits & 0x1 or member.compress_type not in _COMPRESSION:
                    raise ValueError("a compression that is not supported")
                arrays[member.filename.removesuffix(".npy")] = _array(archive.read(member))
            return arrays
    except DAMAGED as error:
        raise ValueError(str(error) or "damaged") from None


def _array(content: bytes) -> NDArray[Any]:
    begin = len(_MAGIC) + 2
    end = begin + int.from_bytes(content[len(_MAGIC) : begin], "little")
    header = _HEADER.fullmatch(content[begin:end])
    if not content.startswith(_MAGIC) or header is None:
        raise ValueError("not an array of numbers or text")
    dtype = np.dtype(header[1].decode("ascii"))
    shape = tuple(int(word) for word in header[3].split(b",") if word.strip())
    if math.prod(shape) * dtype.itemsize != len(content) - end or len(shape) > 8:
        raise ValueError("an array of another size than its header")
    numbers = np.frombuffer(content, dtype=dtype, offset=end)
    if header[2] == b"True":
        return numbers.reshape(shape[::-1]).T.copy()
    return numbers.reshape(shape).copy()
