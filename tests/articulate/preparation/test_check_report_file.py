import json
import math

import pytest

from articulate.assets.check_report import Check, CheckReport, Counts, JointCheck
from articulate.errors import AssetError
from articulate.preparation.check_report_file import content_of, load_proof, save_proof

PROOF = CheckReport(
    asset="cabinet",
    verdict="refused",
    reasons=("sweep of a: it is stuck",),
    repairs=("axis of joint a had length 2: made 1",),
    clauses=(
        Check(name="fk", outcome="passed", measured=2e-9, allowed=1e-6, unit="m or rad"),
        Check(name="fk_input", outcome="passed", measured=3e-8, allowed=1e-6, unit="m or rad"),
        Check(name="openness", outcome="passed", subject="a", measured=0.9, allowed=0.85),
        Check(name="openness", outcome="passed", subject="b", measured=0.97, allowed=0.85),
        Check(name="openness", outcome="not_applicable", subject="c"),
    ),
    joints=(
        JointCheck(
            name="a", kind="slide", span=-0.3, swept=0.4, blocked=True, needs=("b",), opened=0.1
        ),
    ),
    counts=Counts(links=(3, 2), joints=(1, 1), visuals=(4, 4), collisions=(0, 9)),
    source="somewhere",
    licence="MIT",
    colliders=9,
    step_us=4.5,
    seconds=3.2,
)


def test_a_proof_comes_back_as_it_was(tmp_path):
    save_proof(PROOF, tmp_path)
    assert load_proof(tmp_path) == PROOF


def test_the_extremes_are_over_the_clauses_they_belong_to():
    content = content_of(PROOF)
    assert content["fk_max_error_m"] == 3e-8
    assert content["openness_min"] == 0.9
    assert content["joints"] == [
        {
            "name": "a",
            "type": "slide",
            "range": -0.3,
            "swept": 0.4,
            "blocked": True,
            "needs": ["b"],
            "opened": 0.1,
        }
    ]


def test_numbers_that_json_cannot_say_become_null():
    proof = CheckReport(asset="a", verdict="proven", step_us=math.nan)
    assert json.loads(json.dumps(content_of(proof), allow_nan=False))["step_us"] is None


@pytest.mark.parametrize(
    "text", ["", "[]", '{"schema": "other"}', '{"schema": "articulate.proof"}']
)
def test_what_is_no_proof_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "proof.json").write_text(text)
    with pytest.raises(AssetError) as caught:
        load_proof(tmp_path)
    assert "\n" not in str(caught.value)
