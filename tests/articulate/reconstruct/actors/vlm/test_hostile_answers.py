"""Hostile answers do no harm: nothing is written, sent, or printed, and every loop ends."""

from __future__ import annotations

import os

import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import KEY
from tests.articulate.reconstruct.actors.vlm.hostile import KINDS, hostile_answer
from tests.articulate.reconstruct.actors.vlm.server import saying

from articulate.errors import UsageError
from articulate.reconstruct.actors.protocol import Prediction
from articulate.reconstruct.actors.vlm.joint_actor import JointActor
from articulate.reconstruct.actors.vlm.programs import MAX_PROGRAMS

N_ANSWERS = 200
MAX_SENT = 40_000
"""Most characters of one request beyond the prompt."""


def check_harmless(serve, gemini, text, tmp_path, monkeypatch, k):
    here = tmp_path / f"run_{k}"
    here.mkdir()
    monkeypatch.chdir(here)
    server = serve(saying(hostile_answer(k)))
    before = dict(os.environ)
    try:
        found = JointActor(model=gemini, cache=None).propose(text, ())
    except UsageError as caught:
        found = Prediction(joints=(), rejection=str(caught))
    assert all(joint.part in {p.name for p in text.parts} for joint in found.joints)
    assert len(found.rejection) < 1000
    assert "\n" not in found.rejection
    assert KEY not in str(found)
    assert sum(len(step.text) for step in found.trace) < 400_000
    assert len(server.heard) <= 2 * MAX_PROGRAMS
    prompt_size = len(server.heard[0].text)
    for heard in server.heard:
        assert len(heard.text) < prompt_size + 2 * MAX_PROGRAMS * MAX_SENT
        assert KEY not in str(heard.body)
    assert list(here.iterdir()) == []
    assert dict(os.environ) == before


@pytest.mark.parametrize("k", range(len(KINDS)))
def test_a_hostile_answer_of_each_kind_does_no_harm(serve, gemini, text, tmp_path, monkeypatch, k):
    check_harmless(serve, gemini, text, tmp_path, monkeypatch, k)


@pytest.mark.slow
@pytest.mark.parametrize("k", range(len(KINDS), N_ANSWERS))
def test_all_hostile_answers_do_no_harm(serve, gemini, text, tmp_path, monkeypatch, k):
    check_harmless(serve, gemini, text, tmp_path, monkeypatch, k)
