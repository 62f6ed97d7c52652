"""Texts of ``prompts.json`` with the category, parts, sizes and arrangement that they describe."""

import json
from collections import Counter
from pathlib import Path

import pytest
from tests.articulate.reconstruct.text.prompt_match import differences, kind_of

from articulate.errors import UsageError
from articulate.reconstruct.make_object import make_object
from articulate.reconstruct.query import text_query
from articulate.reconstruct.result import MakeRequest
from articulate.reconstruct.text.propose import propose

PROMPTS = json.loads(Path(__file__).with_name("prompts.json").read_text())
SHARE = 0.95
"""Least share of texts whose object has every part, count, size and position."""
PRECISION = 0.9
"""Least share of right objects among those without doubts."""


def is_right(row, proposal):
    if differences(row, proposal):
        return False
    moving = Counter(kind_of(part) for part in proposal.parts if part.motion is not None)
    return row.get("complete", True) and all(
        kind in row["parts"] for kind in moving if proposal.category == "StorageFurniture"
    )


@pytest.mark.parametrize("name", ["development", "published"])
def test_objects_have_the_parts_counts_and_sizes_of_their_text(name):
    wrong = []
    for row in PROMPTS[name]:
        try:
            found = differences(row, propose(row["text"]))
        except UsageError as error:
            found = [str(error)]
        if found:
            wrong.append((row["text"], found))
    assert len(PROMPTS[name]) == 60
    assert 1.0 - len(wrong) / len(PROMPTS[name]) >= SHARE, wrong


def test_objects_without_doubts_are_right():
    right, sure = 0, []
    for row in [*PROMPTS["published"], *PROMPTS["odd"]]:
        try:
            proposal = propose(row["text"])
        except UsageError:
            continue
        if not proposal.doubts:
            sure.append(row["text"])
            right += is_right(row, proposal)
    assert right / len(sure) >= PRECISION


@pytest.mark.slow
@pytest.mark.parametrize("name", ["development", "published"])
def test_assets_of_the_texts_pass_their_checks(name, tmp_path):
    passed, wrong = 0, []
    for k, row in enumerate(PROMPTS[name]):
        try:
            query = text_query(row["text"])
            proposal = propose(query.text)
            request = MakeRequest(out=tmp_path / f"made_{k}", cache=tmp_path / "cache")
            result = make_object(query, proposal, request)
        except UsageError as error:
            wrong.append((row["text"], str(error)))
            continue
        good = result.check_report.is_usable and not differences(row, proposal)
        passed += good
        if not good:
            wrong.append((row["text"], str(result.reasons)))
    assert passed / len(PROMPTS[name]) >= SHARE, wrong
