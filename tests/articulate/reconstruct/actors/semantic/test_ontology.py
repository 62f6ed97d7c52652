import pytest

from articulate.reconstruct.actors.semantic.ontology import object_words_in, role_of, words_of


@pytest.mark.parametrize(
    ("label", "thing", "role"),
    [
        ("handle", "bucket", "bail"),
        ("handle", "furniture", "still"),
        ("door handle", "furniture", "still"),
        ("lid", "bottle", "lift"),
        ("lid", "box", "lid"),
        ("door", "oven", "flap"),
        ("door", "safe", "door"),
        ("toggle button", "switch", "rocker"),
        ("lens", "camera", "spin"),
        ("drawers", "table", "drawer"),
        ("drawerTop", "cabinet", "drawer"),
        ("top", "box", "lid"),
        ("thingummy", "table", "unknown"),
        ("", "table", "unknown"),
    ],
)
def test_what_a_part_does_hangs_on_its_name_and_on_the_thing(label, thing, role):
    assert role_of(label, {thing}) == role


def test_things_are_named_by_the_body_and_by_the_sentence():
    assert object_words_in(["coffee machine body", "door", "knob"], "") == {"coffee", "machine"}
    assert "furniture" in object_words_in(["body"], "a cabinet with two doors")
    assert "door" not in object_words_in(["body"], "a cabinet with two doors")


def test_words_are_told_apart_in_camel_case_and_lose_numbers():
    assert words_of("upperDrawer_02") == ["upper", "drawer"]
    assert words_of("glass") == ["glass"]
