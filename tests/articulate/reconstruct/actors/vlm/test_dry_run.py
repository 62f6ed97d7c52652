"""A dry run writes the exact prompts and asks nobody."""

from __future__ import annotations

import html
import re
import sys
from dataclasses import replace

import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import DOOR_PROGRAM, KEY
from tests.articulate.reconstruct.actors.vlm.server import saying

from articulate.reconstruct.actors.registry import make_actor
from articulate.reconstruct.actors.vlm.actor import vlm_actor
from articulate.reconstruct.actors.vlm.dry_run import dry_run_requests, write_dry_run
from articulate.reconstruct.actors.vlm.joint_actor import JointActor
from articulate.reconstruct.actors.vlm.link_actor import LinkActor


def test_nothing_is_sent_and_the_page_needs_no_other_file(serve, video, tmp_path):
    server = serve(saying("never"))
    path = tmp_path / "prompts.html"
    assert write_dry_run(make_actor("vlm"), video, path, "a cupboard").requests == 3
    assert server.heard == []
    page = path.read_text()
    assert page.count("data:image/png;base64,") == 2 * (8 + 1 + 1) + 1
    assert not re.search(r'(src|href|url)=?[("\']+(?!data:)\w', page)
    assert KEY not in page
    assert "Nothing was sent" in page


def test_the_page_needs_neither_key_nor_package(video, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "httpx", None)
    assert write_dry_run(make_actor("hybrid"), video, tmp_path / "p.html", "it").requests == 2


def test_the_prompt_on_the_page_is_the_one_that_is_sent(serve, video, tmp_path):
    server = serve(saying({"observation": "", "program": DOOR_PROGRAM}))
    actor = vlm_actor()
    actor = replace(actor, proposer=JointActor(assess_placements=True))
    path = tmp_path / "prompts.html"
    write_dry_run(actor, video, path, "a cupboard")
    actor.proposer.propose(video, ())
    page = html.unescape(path.read_text())
    [heard] = server.heard
    assert heard.system in page
    texts = [p["text"] for t in heard.body["contents"] for p in t["parts"] if "text" in p]
    assert len(texts) == 8 + 2 + 2
    assert all(text.removesuffix(":") in page for text in texts)


@pytest.mark.parametrize(
    ("name", "modality", "n"),
    [("vlm", "video", 3), ("vlm", "text", 2), ("hybrid", "video", 2), ("hybrid", "image", 3)],
)
def test_what_hangs_on_an_answer_has_a_stand_in(request, name, modality, n):
    model, found = dry_run_requests(make_actor(name), request.getfixturevalue(modality))
    assert model.name == "gemini-3.8-flash"
    assert len(found) == n
    assert found[0].placeholder == ""
    assert all(dry.placeholder for dry in found[1:])


def test_of_parts_taken_apart_the_first_question_is_where_they_belong(image):
    for actor in (LinkActor(), make_actor("vlm")):
        _, [dry, *_] = dry_run_requests(actor, replace(image, placed=False))
        assert dry.request.title == "placements of the parts"


def test_an_actor_that_asks_no_model_is_refused(image, error_line):
    actor = make_actor("geometric-text")
    error_line("dry_run_requests(geometric-text)", lambda: dry_run_requests(actor, image))
