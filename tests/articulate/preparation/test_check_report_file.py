import json
import math

import pytest

from articulate.assets.check_report import Check, CheckReport, Counts, JointCheck
from articulate.errors import AssetError
from articulate.preparation.check_report_file import (
    content_of,
    load_check_report,
    save_check_report,
)

CHECK_REPORT = CheckReport(
    asset="cabinet",
    verdict="rejected",
    reasons=("sweep of a: it is stuck",),
    repairs=("axis of joint a had length 2: made 1",),
    checks=(
        Check(
            name="forward_kinematics",
            outcome="passed",
            measured=2e-9,
            allowed=1e-6,
            unit="m or rad",
        ),
        Check(
            name="input_kinematics", outcome="passed", measured=3e-8, allowed=1e-6, unit="m or rad"
        ),
        Check(name="cavities", outcome="passed", subject="a", measured=0.9, allowed=0.85),
        Check(name="cavities", outcome="passed", subject="b", measured=0.97, allowed=0.85),
        Check(name="cavities", outcome="not_applicable", subject="c"),
    ),
    joints=(
        JointCheck(
            name="a",
            kind="slide",
            span=-0.3,
            lower=-0.3,
            upper=0.0,
            swept=0.4,
            blocked=True,
            needs=("b",),
            opened=0.1,
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
    save_check_report(CHECK_REPORT, tmp_path)
    assert load_check_report(tmp_path) == CHECK_REPORT


def test_the_extremes_are_over_the_clauses_they_belong_to():
    content = content_of(CHECK_REPORT)
    assert content["kinematics_max_error_m"] == 3e-8
    assert content["cavities_min"] == 0.9
    assert content["joints"] == [
        {
            "name": "a",
            "type": "slide",
            "travel": -0.3,
            "range": [-0.3, 0.0],
            "swept": 0.4,
            "blocked": True,
            "needs": ["b"],
            "opened": 0.1,
        }
    ]


def test_numbers_that_json_cannot_say_become_null():
    check_report = CheckReport(asset="a", verdict="passed", step_us=math.nan)
    assert json.loads(json.dumps(content_of(check_report), allow_nan=False))["step_us"] is None


@pytest.mark.parametrize(
    "text", ["", "[]", '{"schema": "other"}', '{"schema": "articulate.check_report"}']
)
def test_what_is_no_proof_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "check_report.json").write_text(text)
    with pytest.raises(AssetError) as caught:
        load_check_report(tmp_path)
    assert "\n" not in str(caught.value)
