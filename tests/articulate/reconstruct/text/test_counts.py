import re

import pytest

from articulate.reconstruct.text.counts import count_mismatch, counts_in


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
        ("a pair of doors and twenty-one drawers", {"door": 2, "drawer": 21}),
    ],
)
def test_numbers_are_read_where_they_stand_before_a_part(text, counts):
    assert counts_in(text) == counts


def test_only_parts_of_that_name_are_counted():
    labels = ["cabinet body", "drawer", "drawer", "drawer handle"]
    assert count_mismatch("a cabinet with two drawers", labels) == []
    assert count_mismatch("three drawers", labels) == [
        "the text names 3 drawers, the parts include 2"
    ]
    assert len(count_mismatch("one door", labels)) == 1
    assert count_mismatch("two doors", ["body", "mesh door left", "mesh door right"]) == []


@pytest.mark.parametrize(
    ("text", "labels", "wrong"),
    [
        ("a light switch", ["plate", "lever", "lever"], []),
        ("a light switch with two levers", ["plate", "lever", "lever"], []),
        ("a sliding window, one sash", ["frame", "sash"], []),
        ("a light switch with one lever", ["plate", "lever", "lever"], ["1 lever, .* include 2"]),
        ("an oven with a door", ["body", "knob"], ["1 door, .* include 0"]),
        ("a door", ["leaf", "door", "door"], ["1 door, .* include 2"]),
    ],
)
def test_a_word_that_names_the_object_itself_is_no_count_of_its_parts(text, labels, wrong):
    found = count_mismatch(text, labels)
    assert len(found) == len(wrong)
    assert all(re.search(pattern, line) for pattern, line in zip(wrong, found, strict=True))
