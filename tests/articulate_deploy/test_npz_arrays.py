import io
import zipfile

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from articulate.errors import BundleError
from articulate_deploy.npz_arrays import read_tables


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def packed(header, content, how=zipfile.ZIP_DEFLATED, repeat=1):
    """An npz file of one array ``values`` with a header of our choice."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", how) as archive, archive.open("values.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, header)
        for _ in range(repeat):
            member.write(content)
    return stream.getvalue()


def refused(content):
    with pytest.raises(BundleError, match="does not hold 2 rows"):
        read_tables(content, {"values": (2, 3)}, "f.npz", "2 rows")


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("order", ["C", "F"])
def test_what_numpy_writes_is_read(dtype, order):
    values = np.asarray(np.arange(6).reshape(2, 3), dtype=dtype, order=order)
    content = npz(values=values, other=values[:1].copy())
    tables = read_tables(content, {"values": (2, 3), "other": (1, 3)}, "f", "rows")
    assert_array_equal(tables["values"], values)
    assert_array_equal(tables["other"], values[:1])
    assert tables["values"].dtype == np.float64


@pytest.mark.parametrize(
    "values",
    [
        np.zeros((3, 2)),
        np.zeros(6),
        np.zeros((2, 3), dtype=int),
        np.zeros((2, 3), dtype=">f8"),
        np.array([{"a": 1}], dtype=object),
        np.zeros((2, 3), dtype="datetime64[s]"),
    ],
)
def test_other_arrays_are_refused(values):
    refused(npz(values=values))


def test_a_file_that_lacks_the_table_or_is_none_is_refused():
    refused(npz(other=np.zeros((2, 3))))
    refused(b"hello")
    refused(npz(values=np.zeros((2, 3)))[:-30])


def test_a_header_that_promises_too_much_takes_no_memory():
    refused(packed({"descr": "<f8", "fortran_order": False, "shape": (10**15,)}, b""))
    refused(packed({"descr": "<f8", "fortran_order": False, "shape": (2, 3)}, b"short"))


def test_a_file_that_unpacks_to_more_than_a_bundle_is_refused():
    """0.1 MB here; the sizes are read before anything is unpacked."""
    header = {"descr": "<f8", "fortran_order": False, "shape": (9_000_000, 1)}
    content = packed(header, bytes(1 << 20), repeat=70)
    assert len(content) < 1 << 17
    refused(content)


def test_a_damaged_or_strangely_packed_file_is_refused():
    header = {"descr": "<f8", "fortran_order": False, "shape": (2, 3)}
    for how in (zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2):
        refused(packed(header, bytes(48), how))
    content = bytearray(packed(header, bytes(48)))
    begin = content.index(b"values.npy") + len(b"values.npy") + 20
    content[begin : begin + 8] = b"\xff" * 8
    refused(bytes(content))
