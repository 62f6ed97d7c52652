"""Units of a file: metres, or guessed from the size and the category."""

from pathlib import Path

import pytest

from articulate.conversion.metric_size import UNITS_M, scale_of
from articulate.errors import AssetError
from articulate.formats.config import ConvertConfig


@pytest.mark.parametrize(
    ("longest", "category", "unit"),
    [
        (0.8, None, None),
        (4.0, None, None),
        (7.0, None, None),
        (50.0, None, "cm"),
        (400.0, None, "mm"),
        (1200.0, None, "mm"),
        (85.0, "StorageFurniture", "cm"),
        (800.0, "StorageFurniture", "mm"),
        (20.0, "StorageFurniture", "inch"),
        (14.0, "Pen", "cm"),
        (1.2, "Pen", None),
    ],
)
def test_the_unit_is_guessed_from_size_and_category(
    tmp_path: Path, longest: float, category: str | None, unit: str | None
) -> None:
    scale, rule = scale_of(tmp_path / "a.urdf", ConvertConfig(category=category), longest)
    assert scale == (1.0 if unit is None else UNITS_M[unit])
    assert (f"numbers are {unit}" in rule) is (unit is not None)


@pytest.mark.parametrize("longest", [0.001, 9.0, 20.0, 200.0, 1e5])
def test_a_size_that_fits_no_unit_or_several_is_rejected_with_the_flag(
    tmp_path: Path, longest: float
) -> None:
    with pytest.raises(AssetError, match=r"in metres with --size$"):
        scale_of(tmp_path / "a.urdf", ConvertConfig(), longest)
    assert scale_of(tmp_path / "a.urdf", ConvertConfig(size_m=0.5), longest)[0] == 0.5 / longest
