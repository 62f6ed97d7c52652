from __future__ import annotations

import numpy as np
import pytest

from articulate.errors import ConfigError, MissingError
from articulate.reconstruct.actors.prior import PriorActor
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint
from articulate.reconstruct.actors.registry import make_actor
from articulate.render.parts import plain_part
from articulate.transforms import apply

TETRA = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])


def lump(name: str, low, high):
    low, high = np.asarray(low, float), np.asarray(high, float)
    corners = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]], dtype=float)
    return plain_part(name, low + corners * (high - low), TETRA)


def test_a_hinge_turns_about_its_pivot_and_a_slide_goes_along_its_axis():
    hinge = PredictedJoint(
        part="a", parent=None, kind="revolute", axis_o=(0, 0, 2), pivot_o=(1, 0, 0)
    )
    assert apply(hinge.T_o(np.pi / 2), [2.0, 0.0, 0.5]) == pytest.approx([1.0, 1.0, 0.5])
    slide = PredictedJoint(part="a", parent=None, kind="prismatic", axis_o=(0, 3, 0))
    assert apply(slide.T_o(0.2), [0.0, 0.0, 0.0]) == pytest.approx([0.0, 0.2, 0.0])
    assert hinge.T_o(np.zeros((2, 3))).shape == (2, 3, 4, 4)


def test_a_fixed_joint_moves_nothing():
    fixed = PredictedJoint(part="a", parent=None, kind="fixed")
    assert np.array_equal(fixed.T_o(3.0), np.eye(4))


def test_parts_of_the_evidence_are_found_by_name():
    evidence = Evidence(modality="text", parts=(lump("p", (0, 0, 0), (1, 1, 1)),))
    assert evidence.part("p").name == "p"
    with pytest.raises(KeyError):
        evidence.part("q")


def cupboard(**labels: str) -> Evidence:
    parts = (
        lump("body", (-0.5, -0.5, 0), (0.5, 0.5, 1)),
        lump("front", (0.5, -0.5, 0.5), (0.53, 0.0, 1.0)),
    )
    return Evidence(modality="text", parts=parts, labels={"body": "cabinet body", **labels})


@pytest.mark.parametrize(
    ("label", "kind"),
    [("drawer", "prismatic"), ("cabinet door", "revolute"), ("knob", "continuous")],
)
def test_the_prior_says_what_parts_of_this_name_mostly_do(label, kind):
    joints = PriorActor().predict(cupboard(front=label)).joints
    assert [(j.part, j.kind) for j in joints] == [("front", kind)]


def test_the_prior_opens_a_door_outwards_about_its_outer_edge():
    door = PriorActor().predict(cupboard(front="door")).joints[0]
    assert door.pivot_o[1] == pytest.approx(-0.5)
    opened = apply(door.T_o(np.array(door.lower, dtype=float)), [0.5, 0.0, 0.75])
    assert opened[0] > 0.9  # the free edge is in front of the body


def test_the_prior_says_nothing_of_what_it_does_not_know():
    assert PriorActor().predict(cupboard(front="gizmo")).joints == ()


def test_actors_are_made_by_name_or_by_module_and_class():
    assert make_actor("prior").name == "prior"
    assert make_actor("articulate.reconstruct.actors.prior:PriorActor").name == "prior"


@pytest.mark.parametrize(
    "name",
    ["priar", "no.such.module:A", "articulate.reconstruct.actors.prior:Missing", ":x", ".a:b"],
)
def test_an_actor_that_does_not_exist_is_refused(name, error_line):
    error_line(f'make_actor("{name}")', lambda: make_actor(name))


def test_an_actor_that_wants_to_be_told_something_is_refused(tmp_path, monkeypatch, error_line):
    text = "class Actor:\n    def __init__(self, key): ...\n"
    (tmp_path / "wants_more.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    error_line("make_actor(an actor with arguments)", lambda: make_actor("wants_more:Actor"))


def test_an_actor_whose_package_is_missing_says_which(tmp_path, monkeypatch):
    (tmp_path / "needs_more.py").write_text("import package_that_is_not_there\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(MissingError, match="package_that_is_not_there"):
        make_actor("needs_more:Actor")
    with pytest.raises(ConfigError):
        make_actor("articulate.reconstruct.actors.prior:")


@pytest.mark.parametrize("name", ["os:getcwd", "builtins:dict"])
def test_what_gives_no_actor_is_refused(name, error_line):
    error_line(f'make_actor("{name}")', lambda: make_actor(name))
