import re

import numpy as np
import pytest
from tests.articulate.reconstruct.text.prompt_match import differences

from articulate.errors import ConfigError
from articulate.reconstruct.text.measures import find_measures, with_digits
from articulate.reconstruct.text.parse import parse
from articulate.reconstruct.text.propose import propose


def sizes(text):
    measured = find_measures(with_digits(text.lower()))
    return {
        m.dimension: round(m.value * (m.unit_m or 1.0), 4)
        for group in measured.measures
        for m in group
    }


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("60x40x80 cm", {"first": 0.6, "second": 0.4, "third": 0.8}),
        ("60cm(W) x 40cm(D) x 80cm(H)", {"width": 0.6, "depth": 0.4, "height": 0.8}),
        ("80 x 40 x 180 cm (w x d x h)", {"width": 0.8, "depth": 0.4, "height": 1.8}),
        ("W 60 D 40 H 80", {"width": 60.0, "depth": 40.0, "height": 80.0}),
        ("half a metre wide", {"width": 0.5}),
        ("one and a half metres tall", {"height": 1.5}),
        ("5'6\" tall", {"height": 1.6764}),
        ("5 ft 6 in tall, 18 in deep", {"height": 1.6764, "depth": 0.4572}),
        ("18 1/2 inches wide", {"width": 0.4699}),
        ("1,200 mm wide and 0,5 m deep", {"width": 1.2, "depth": 0.5}),
        ("radius of 15 cm", {"diameter": 0.3}),
        ("a 24 inch dishwasher", {"any": 0.6096}),
        ("a 3 by 3 grid", {}),
        ("a 40 cm cube", {"first": 0.4, "second": 0.4, "third": 0.4}),
        ("one tall door and 3 deep drawers", {}),
    ],
)
def test_lengths_are_read_in_any_notation(text, expected):
    assert sizes(text) == pytest.approx(expected)


def test_all_words_for_the_size_count():
    scaled = parse("a tall narrow cabinet with two doors").scale
    assert scaled == {"height": 1.3, "width": 0.7}


@pytest.mark.parametrize(
    ("text", "litres"),
    [
        ("a 50 litre pedal bin", 50.0),
        ("a half-litre bottle", 0.5),
        ("bucket with a capacity of 5 gallons", 18.925),
        ("a kettle of 1.7l", 1.7),
        ("sideboard 160 w x 40 l x 80 h", None),
    ],
)
def test_volume_is_read_with_its_unit(text, litres):
    volume_m3 = parse(text).volume_m3
    assert volume_m3 == (None if litres is None else pytest.approx(litres / 1000.0))


def test_usual_sizes_are_scaled_to_the_volume():
    small, large = (propose(f"a {litres} litre bucket").assumptions[0] for litres in (6, 12))
    numbers = [[float(x) for x in re.findall(r"(\d\.\d+) m", text)] for text in (small, large)]
    assert numbers[1] == pytest.approx([x * 2 ** (1 / 3) for x in numbers[0]], rel=0.05)
    assert (
        "volume of 12 l: the text gives sizes"
        in propose("a 12 litre bucket, 30 cm high").assumptions
    )


@pytest.mark.parametrize("litres", [0, 5000])
def test_a_volume_out_of_range_is_rejected_with_the_range(litres):
    with pytest.raises(
        ConfigError, match=rf"a volume of {litres} l is not possible .* in \[.*\] l"
    ):
        propose(f"a {litres} litre bucket")


def test_a_side_at_its_limit_leaves_the_volume_to_the_others():
    (text,) = (a for a in propose("a 240 l chest freezer").assumptions if "240 l" in a)
    sides = [float(x) for x in re.findall(r"(\d\.\d+|\d\.?) m", text)]
    assert 1000.0 * np.prod(sides) / 1.2 == pytest.approx(240.0, rel=0.03)


def test_doors_with_a_level_hinge_do_not_slide():
    doubts = propose("a cabinet with sliding doors that open downward").doubts
    assert "the doors are made with a hinge and do not slide" in doubts


def groups(text):
    return [(g.kind, g.count, g.position) for g in parse(text).groups]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a cabinet with two drawers above a door", [("drawer", 2, ""), ("door", 1, "")]),
        ("a cabinet: doors: 2; drawers: 3", [("door", 2, ""), ("drawer", 3, "")]),
        ("a twin-door cabinet", [("door", 2, "")]),
        (
            "six drawers, two on the left and four on the right, in a cabinet",
            [("drawer", 2, "left"), ("drawer", 4, "right")],
        ),
        (
            "sideboard; left: 3 drawers; right: door",
            [("drawer", 3, "left"), ("door", 1, "right")],
        ),
        ("a desk with three drawers on each side", [("drawer", 6, "ends")]),
        ("a two-drawer cabinet with two drawers", [("drawer", 2, "")]),
        ("a chest with three columns of drawers, three each", [("drawer", 9, "")]),
    ],
)
def test_groups_of_parts_are_read(text, expected):
    assert groups(text) == expected


@pytest.mark.parametrize(
    ("text", "link"),
    [
        ("a cabinet with a drawer above a door", (0, "above", 1)),
        ("a cabinet with a drawer and, underneath, a door", (0, "above", 1)),
        ("a cabinet with a door and above it a drawer", (1, "above", 0)),
        ("a cabinet with a drawer below a door", (1, "above", 0)),
        ("a cabinet with a door to the right of two drawers", (1, "left", 0)),
        ("a cabinet with two doors flanked by four drawers", (0, "between", 1)),
    ],
)
def test_relations_are_read(text, link):
    (relation,) = parse(text).relations
    assert (relation.first, relation.link, relation.second) == link


@pytest.mark.parametrize(
    ("text", "axes"),
    [
        ("a wardrobe with sliding doors", [-1, 1]),
        ("a cabinet with three doors that slide sideways", [-1, 1, 1]),
        ("a sideboard with four sliding oak doors", [-1, 1, -1, 1]),
        ("a cabinet with one sliding door on the left and two shelves on the right", [-1]),
    ],
)
def test_sliding_doors_move_along_the_front(text, axes):
    doors = [part.motion for part in propose(text).parts if part.motion is not None]
    assert [(one.kind, one.axis) for one in doors] == [("prismatic", (0.0, y, 0.0)) for y in axes]


def test_a_single_sliding_door_passes_before_the_handles_of_drawers():
    parts = {part.name: part for part in propose("a sideboard, one sliding door, 3 drawers").parts}

    def x_of(name, shapes):
        """Return the coordinates x of the corners of shapes of a part (N,)."""
        motion = parts[name].motion
        assert motion is not None
        corners = [solid.mesh()[0] for shape in shapes for solid in shape.solids]
        return motion.origin_p[0] + np.concatenate(corners)[:, 0]

    door = [one for one in parts["door_0"].shapes if one.name.endswith("front")]
    assert x_of("door_0", door).max() < x_of("drawer_0", parts["drawer_0"].shapes).min()


S, FRIDGE = "StorageFurniture", "Refrigerator"
ARRANGED = [
    (
        "cabinet with two drawers in the top row and three drawers in the bottom row",
        {"category": S, "parts": {"drawer": 5}, "grid": {"drawer": [2, 5]}},
    ),
    (
        "an apothecary cabinet: 4 rows, 5 columns of little drawers",
        {"category": S, "parts": {"drawer": 20}, "grid": {"drawer": [4, 5]}},
    ),
    (
        "a dresser that has three rows of drawers, with two drawers per row",
        {"category": S, "parts": {"drawer": 6}, "grid": {"drawer": [3, 2]}},
    ),
    (
        "two-door, two-drawer base cabinet with drawers over doors",
        {"category": S, "parts": {"drawer": 2, "door": 2}, "above": [["drawer", "door"]]},
    ),
    (
        "a cabinet with three drawers in the middle and doors on the left and on the right",
        {"category": S, "parts": {"drawer": 3, "door": 2}, "between": [["drawer", "door"]]},
    ),
    (
        "a cabinet with three doors; the middle one is hinged on the left",
        {"category": S, "parts": {"door": 3}, "hinges": {"door": ["left", "left", "right"]}},
    ),
    (
        "a cabinet with two flaps side by side and one drawer beneath each",
        {"category": S, "parts": {"door": 2, "drawer": 2}, "above": [["door", "drawer"]]},
    ),
    (
        "a refrigerator with two doors, the upper one for the freezer",
        {"category": FRIDGE, "parts": {"door": 2}, "grid": {"door": [2, 1]}},
    ),
    (
        "a fridge with four doors and a drawer in the middle",
        {"category": FRIDGE, "parts": {"door": 4, "drawer": 1}, "grid": {"door": [2, 2]}},
    ),
    (
        "a desk with two pedestals of three drawers each",
        {"category": "Table", "parts": {"drawer": 6}, "grid": {"drawer": [3, 2]}},
    ),
    (
        "a wooden chest 50 cm long, 30 cm wide and 20 cm high with a lid",
        {"category": "Box", "parts": {"lid": 1}, "size_m": {"width": 0.5, "depth": 0.3}},
    ),
    (
        "a dresser with two small drawers on top of three wide ones",
        {"category": S, "parts": {"drawer": 5}},
    ),
    (
        "a wooden chest 1 m long with a lid hinged at the back",
        {"category": "Box", "parts": {"lid": 1}, "size_m": {"width": 1.0}},
    ),
    (
        "a microwave with a double-walled door",
        {"category": "Microwave", "parts": {"door": 1}},
    ),
    (
        "a sideboard with three drawers across the top and three doors below them",
        {"category": S, "parts": {"drawer": 3, "door": 3}, "above": [["drawer", "door"]]},
    ),
    ("a double oven", {"category": "Oven", "parts": {"door": 2}, "grid": {"door": [2, 1]}}),
]


@pytest.mark.parametrize(("text", "expected"), ARRANGED, ids=[text for text, _ in ARRANGED])
def test_objects_are_arranged_as_in_their_text(text, expected):
    proposal = propose(text)
    assert not differences(expected, proposal)
    assert not proposal.doubts


@pytest.mark.parametrize(
    ("text", "sizes_m"),
    [
        (
            "a fridge 60 cm wide, 65 cm deep and 180 cm tall with 4 cm thick walls",
            {"width": 0.6, "depth": 0.65, "height": 1.8},
        ),
        ("a cabinet 80 cm wide with walls that are 18 mm thick", {"width": 0.8}),
        ("a wooden box, wall thickness 12 mm, 60 cm wide", {"width": 0.6}),
        ("a microwave with a door, thickness of the door 4 cm", {}),
        ("a safe with a steel door 5 cm thick and 8 mm walls", {}),
        ("a chest of three drawers made from 16 mm boards, 90 cm high", {"height": 0.9}),
        ("a cupboard of 18 mm plywood with one door", {}),
        ("a sideboard on 15 cm high legs", {}),
        ("a kitchen unit with a 38 mm worktop and two doors, 60 cm wide", {"width": 0.6}),
    ],
)
def test_size_of_a_component_is_not_a_size_of_the_object(text, sizes_m):
    assert parse(text).sizes_m == pytest.approx(sizes_m)
    assert any("is a size of a part, which cannot be set" in d for d in propose(text).doubts)


@pytest.mark.parametrize(
    ("text", "sizes_m"),
    [
        ("a door 80 cm wide and 4 cm thick", {"width": 0.8, "depth": 0.04}),
        ("a suitcase 70 cm high and 28 cm thick", {"height": 0.7, "depth": 0.28}),
        ("a laptop 2 cm thick", {"height": 0.02}),
        ("a 60 cm oak cabinet", {"any": 0.6}),
    ],
)
def test_thickness_of_a_flat_object_is_a_size_of_the_object(text, sizes_m):
    assert parse(text).sizes_m == pytest.approx(sizes_m)
    assert not propose(text).doubts


@pytest.mark.parametrize(
    ("text", "category", "unknown"),
    [
        ("a chest freezer, 1 m wide", "box_with_lid", []),
        ("a bread box with a lid", "box_with_lid", []),
        ("laundry hamper with a lid, 60 cm high", "trash_can", []),
        ("mailbox with a front door that opens downward", "furniture", []),
        ("a rolling tool chest with 5 drawers and a lock", "furniture", []),
        ("medicine cabinet with a mirror door", "furniture", []),
        ("a server rack with a glass front door", "furniture", []),
    ],
)
def test_household_nouns_are_understood(text, category, unknown):
    found = parse(text)
    assert (found.category, found.unknown) == (category, unknown)


@pytest.mark.parametrize(("noun", "moving"), [("hamper", {"lid"}), ("bin", {"lid", "pedal"})])
def test_hampers_have_no_pedal(noun, moving):
    parts = propose(f"a {noun} with a lid").parts
    assert {part.name for part in parts if part.motion is not None} == moving


def test_words_that_are_not_understood_make_the_object_doubtful():
    proposal = propose("a cabinet with two drawers and a wine rack")
    assert proposal.doubts == ("not understood: wine, rack",)
    assert proposal.confidence < 0.9
    assert not propose("please make a modern cabinet with two drawers").doubts


@pytest.mark.parametrize(
    ("text", "same"),
    [
        (
            "tall wardrobe w/ three doors w/o handles",
            "tall wardrobe with three doors without handles",
        ),
        ("a box, 0.3 m cube", "a box 0.3 x 0.3 x 0.3 m"),
        ("a stainless dishwasher", "a stainless steel dishwasher"),
    ],
)
def test_short_forms_are_understood(text, same):
    ours, other = propose(text), propose(same)
    assert not ours.doubts
    assert ours.parts == other.parts


def test_drawers_of_a_refrigerator_without_doors_are_its_only_parts():
    parts = propose("a refrigerator with three drawers and no doors").parts
    assert [p.name for p in parts] == ["body", "drawer_0", "drawer_1", "drawer_2"]


def test_moving_parts_that_the_text_does_not_name_are_assumptions():
    assumptions = propose("an oven with a drop-down door and four knobs").assumptions
    assert "1 drawer: usual for an oven" in assumptions
    assert not any("drawer" in one for one in propose("an oven with a drawer").assumptions)


def test_joints_have_their_evidence():
    proposal = propose("a washing machine with a drawer")
    assert proposal.evidence == {"door": "category", "drawer": "text", "dial": "category"}


@pytest.mark.parametrize(
    "text",
    [
        "hello",
        "an airplane",
        "a cabinet with two drawers and no drawers",
        "a cabinet with doors only and two drawers",
        "a chest of ten drawers in 2 rows of 3",
        "a cabinet 1 mm wide",
        "a cabinet 60 cm wide and 80 cm wide",
        "a wardrobe 20 cm wide with four doors",
        "a kettle with two lids",
        "a refrigerator with no doors",
        "a microwave with two doors",
        "a cabinet 5 km wide",
        "a box without a lid",
        "a washing machine hinged at the bottom",
        "a table and a chair",
        "two cabinets",
        "ein Schrank mit zwei Türen",
        "un armario con dos puertas",
        "冷蔵庫",
    ],
)
def test_impossible_texts_are_rejected_in_one_line(text, error_line):
    error_line(f"articulate make --text {text!r}", lambda: propose(text))
