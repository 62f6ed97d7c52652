"""With ``--joint all`` names add what the clip does not show, and change nothing that it shows."""

from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.make import _with_unseen


def said(part, parent, kind="revolute"):
    return PredictedJoint(part=part, parent=parent, kind=kind)


SEEN = (said("door", "body"), said("knob", "door", "fixed"))


def test_knob_that_goes_along_in_the_clip_may_turn_by_its_name():
    turns = said("knob", "door", "continuous")
    assert _with_unseen(SEEN, [turns]) == (*SEEN, turns)


def test_what_the_clip_shows_stands():
    named = [said("door", "body", "prismatic"), said("knob", "body", "fixed")]
    assert _with_unseen(SEEN, named) == SEEN


def test_what_the_clip_says_nothing_of_is_added():
    drawer, shelf = said("drawer", "body", "prismatic"), said("shelf", "body", "fixed")
    assert _with_unseen(SEEN, [drawer, shelf]) == (*SEEN, drawer, shelf)
