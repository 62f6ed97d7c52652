import contextlib
import io
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from articulate.npz_file import read_npz

ARRAYS = {
    "floats": np.arange(6.0).reshape(2, 3),
    "columns": np.asfortranarray(np.arange(6, dtype=np.int16).reshape(2, 3)),
    "flags": np.array([True, False]),
    "names": np.array(["drawer", "door"]),
    "scalar": np.array(2.5, dtype=np.float32),
    "none": np.zeros((0, 3)),
}


def npz(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def test_arrays_are_read_as_numpy_reads_them():
    found = read_npz(npz(**ARRAYS), 10_000)
    assert found.keys() == ARRAYS.keys()
    for name, values in ARRAYS.items():
        assert found[name].dtype == values.dtype
        assert_array_equal(found[name], values)


@given(st.integers(0, 5000), st.integers(1, 255), st.integers(0, 5000))
@settings(max_examples=300, deadline=None)
def test_a_damaged_file_raises_value_errors_only(at, flip, end):
    content = bytearray(npz(**ARRAYS))
    content[at % len(content)] ^= flip
    for damaged in (bytes(content), bytes(content[:end])):
        with contextlib.suppress(ValueError):
            read_npz(damaged, 10_000)


@pytest.mark.parametrize("dtype", ["<f3", "<i5", "|b8", "<U0", ">f8x", "|O"])
def test_unknown_numbers_are_rejected(dtype):
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': (1,), }}\n".encode()
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        start = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little")
        archive.writestr("a.npy", start + header + bytes(8))
    with pytest.raises(ValueError, match=r"\w"):
        read_npz(stream.getvalue(), 10_000)


def test_the_limit_counts_all_arrays():
    content = npz(a=np.zeros(100), b=np.zeros(100))
    assert read_npz(content, 2000)["b"].shape == (100,)
    with pytest.raises(ValueError, match="larger than 1500 bytes"):
        read_npz(content, 1500)
