import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from articulate.task.layout import Field, Layout, layout_from_list

AB = Layout(
    (
        Field(name="a", size=2, unit="rad", frame="-", source="robot"),
        Field(name="b", size=1, unit="m", frame="tool", source="estimator", low=-1.0, high=2.0),
    )
)


def test_fields_stand_one_after_another():
    assert AB.size == 3
    assert (AB.slice("a"), AB.slice("b")) == (slice(0, 2), slice(2, 3))
    assert AB.low.tolist() == [-10, -10, -1]
    assert AB.high.tolist() == [10, 10, 2]


@given(a=st.floats(-100, 100), b=st.floats(-100, 100))
def test_packed_values_stand_in_their_slices_clipped_to_their_bounds(a, b):
    packed = AB.pack({"b": np.array([b]), "a": np.array([[a, -a]])})
    assert packed.shape == (1, 3)
    assert_array_equal(packed[0, AB.slice("a")], np.clip([a, -a], -10, 10))
    assert packed[0, 2] == np.clip(b, -1, 2)


def test_layout_written_to_a_manifest_is_read_back():
    assert layout_from_list(AB.as_list()) == AB


def test_what_does_not_fit_is_refused(error_line):
    two = {"a": np.zeros((1, 2))}
    error_line('Layout.pack(a) without "b"', lambda: AB.pack(two))
    error_line(
        "Layout.pack(a of 3 numbers)",
        lambda: AB.pack({"a": np.zeros((1, 3)), "b": np.zeros(1)}),
    )
    error_line('Layout.slice("c")', lambda: AB.slice("c"))
    error_line("Layout(a, a)", lambda: Layout((AB.fields[0], AB.fields[0])))
    shifted = [{**AB.as_list()[0], "slice": [0, 3]}, AB.as_list()[1]]
    error_line("layout_from_list(slice of a too long)", lambda: layout_from_list(shifted))
    foreign = [{**AB.as_list()[0], "colour": "red"}]
    error_line("layout_from_list(field with a colour)", lambda: layout_from_list(foreign))
