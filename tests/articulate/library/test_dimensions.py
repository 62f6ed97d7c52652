"""Ranges of dimensions."""

from dataclasses import dataclass, fields

import pytest

from articulate.errors import ConfigError
from articulate.library.procedural.categories import CATEGORIES
from articulate.library.procedural.dimensions import Dimensions, between, integer, one_of


@dataclass(frozen=True, kw_only=True)
class Crate(Dimensions):
    category = "Box"
    width_m: float = between(0.2, 0.4)
    slats: int = integer(2, 4)
    wood: str = one_of("oak", "birch")

    def parts(self):
        return []


def test_seed_0_is_the_middle_and_the_first():
    assert Crate.sample(0) == Crate(width_m=0.3, slats=3, wood="oak")


def test_draws_fill_their_ranges_and_depend_on_the_seed_alone():
    drawn = [Crate.sample(seed) for seed in range(1, 200)]
    assert drawn == [Crate.sample(seed) for seed in range(1, 200)]
    assert {crate.slats for crate in drawn} == {2, 3, 4}
    assert {crate.wood for crate in drawn} == {"oak", "birch"}
    widths = [crate.width_m for crate in drawn]
    assert 0.2 <= min(widths) < 0.21
    assert 0.39 < max(widths) <= 0.4


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"width_m": 0.5}, r"Crate.width_m is 0.5; it must be in \[0.2, 0.4\]"),
        ({"slats": 5}, r"Crate.slats is 5; it must be in \[2, 4\]"),
        ({"wood": "oack"}, "Crate.wood is 'oack'; did you mean oak"),
    ],
)
def test_what_is_out_of_range_is_answered_in_one_line(given, says):
    with pytest.raises(ConfigError, match=says):
        Crate(**{"width_m": 0.3, "slats": 3, "wood": "oak", **given})


def test_a_seed_below_0_is_refused():
    with pytest.raises(ConfigError, match="seed is -1; it must be at least 0"):
        Crate.sample(-1)


@pytest.mark.parametrize("name", [name for name in CATEGORIES if name != "cabinet"])
def test_every_dimension_of_every_category_has_a_range(name):
    dimensions = CATEGORIES[name].dimensions
    for field in fields(dimensions):  # type: ignore[arg-type]
        assert set(field.metadata) & {"between", "integers", "choices"}, field.name
