import pytest

from articulate.make.spoken import counts_in, miscounted


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        ("a cabinet with two drawers", {"drawer": 2}),
        ("A cabinet with a door and 3 small drawers", {"door": 1, "drawer": 3}),
        ("a chest of drawers", {}),
        ("two upper drawers and one lower drawer", {"drawer": 3}),
        ("an oven door", {"door": 1}),
        ("drawers", {}),
        ("two cabinets with doors", {}),
    ],
)
def test_numbers_are_read_where_they_stand_before_a_part(text, counts):
    assert counts_in(text) == counts


def test_only_parts_of_that_name_are_counted():
    labels = ["cabinet body", "drawer", "drawer", "drawer handle"]
    assert miscounted("a cabinet with two drawers", labels) == []
    assert miscounted("three drawers", labels) == ["the text says 3 drawers, and the parts hold 2"]
    assert len(miscounted("one door", labels)) == 1
