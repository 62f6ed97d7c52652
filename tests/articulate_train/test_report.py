import dataclasses
import html
import json
import re

import numpy as np
import pytest

from articulate.task.episode_monitor import COLUMN, WIDTH, FailureReason
from articulate.task.randomization import COLUMNS, sample_episode_params
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig
from articulate_envs.rewards import TERMS
from articulate_train.report import (
    Curve,
    RunInfo,
    SeedEvaluation,
    Timeline,
    make_report,
)
from articulate_train.report_html import (
    MAX_EMBEDDED_BYTES,
    MAX_POSTER_BYTES,
    report_page,
    write_report,
)

PNG = b"\x89PNG\r\n\x1a\n" + bytes(200)
INFO = RunInfo(
    name="first",
    asset="cabinet",
    task="open_drawer",
    joint="drawer_0_slide",
    target_text="open by at least 0.224 m and at rest",
    target=0.8,
    steps=2_000_000,
    seconds=1733.0,
    steps_per_s=3462.0,
    versions={"mujoco": "3.9.0"},
    command="articulate train cabinet.urdf --seeds 0 1",
    config="asset: cabinet.urdf\nseeds: [0, 1]\n",
    licence="MIT",
    source="made for tests",
    commit="0123abc",
)


def _seed(seed, codes, *, nominal=(0, 0, 0, 0), config=None):
    codes = np.asarray(codes, dtype=np.int64)
    peaks = np.zeros((len(codes), WIDTH))
    peaks[:, COLUMN["force"]] = np.where(
        codes == FailureReason.FORCE, 50.0, np.linspace(10, 20, len(codes))
    )
    peaks[:, COLUMN["code"]] = np.where(codes <= 6, codes, 0)
    peaks[:, COLUMN["violation_time"]] = np.where(peaks[:, COLUMN["code"]] > 0, 3.0, 0.0)
    nominal = np.asarray(nominal, dtype=np.int64)
    return SeedEvaluation(
        seed=seed,
        codes=codes,
        opened=codes != FailureReason.GOAL_NOT_REACHED,
        peaks=peaks,
        params=sample_episode_params(
            config or RandomizationConfig(), np.random.default_rng(seed), len(codes)
        ).values,
        nominal_codes=nominal,
        nominal_opened=np.ones(len(nominal), dtype=bool),
    )


def _curve(seed):
    steps = np.linspace(1e4, 2e6, 50)
    success = steps / 2e6
    success[:2] = np.nan
    terms = np.outer(steps / 2e6, np.arange(len(TERMS)) - 4.0)
    return Curve(seed=seed, steps=steps, success=success, opened=success, reward_terms=terms)


def _timeline(name, reason):
    t = np.linspace(0.05, 10.0, 200)
    sampled = sample_episode_params(RandomizationConfig(), np.random.default_rng(3)).values[0]
    return Timeline(
        name=name,
        reason=reason,
        t=t,
        force_n=20 * t / 10,
        speed_share=t / 20,
        opened=t / 12,
        params=dict(zip(COLUMNS, sampled, strict=True)),
    )


def _report(info=INFO, seeds=None, *, curves=True, timelines=True, videos=()):
    force, closed = FailureReason.FORCE, FailureReason.GOAL_NOT_REACHED
    if seeds is None:
        seeds = [_seed(0, [0] * 30 + [force] * 6 + [closed] * 4), _seed(7, [0] * 38 + [closed] * 2)]
    return make_report(
        info,
        seeds,
        [_curve(0), _curve(7)] if curves else [],
        [_timeline("success", "success"), _timeline("failure", "force")] if timelines else [],
        videos,
        np.random.default_rng(0),
    )


def test_success_rate_is_the_mean_over_seeds_of_their_shares():
    report = _report(INFO, [_seed(0, [0, 0, 0, 5]), _seed(1, [0] * 50 + [7] * 50)])
    assert report.success_rate == pytest.approx((0.75 + 0.5) / 2)
    assert report.worst_seed_success_rate == 0.5
    assert report.opened_rate == pytest.approx((1.0 + 0.5) / 2)
    assert report.nominal_success_rate == 1.0
    assert (report.success_pooled.value, report.success_pooled.n) == (53 / 104, 104)


def test_the_member_that_acts_only_is_reported(tmp_path):
    one = dataclasses.replace(_seed(0, [0] * 40), policy_steps=1_670_000, active_member=1)
    report = _report(seeds=[one, dataclasses.replace(_seed(7, [0] * 40), policy_steps=1_780_000)])
    assert [s.active_member for s in report.seeds] == [1, None]
    page = write_report(report, tmp_path)[1].read_text(encoding="utf-8")
    assert "1.67M steps, ensemble member 1 only" in page
    assert page.count("only<") == 1


def test_reasons_are_counted_by_name_and_add_up():
    report = _report()
    assert report.reasons == {"success": 68, "force": 6, "goal_not_reached": 6}
    assert report.seeds[1].reasons == {"success": 38, "goal_not_reached": 2}
    assert sum(report.reasons.values()) == report.success_iqm.n


def test_violations_state_when_a_limit_was_broken_and_endings_do_not():
    (violation,) = _report().violations
    assert (violation.reason, violation.episodes, violation.median_s) == ("force", 6, 3.0)


def test_peaks_stand_beside_what_is_allowed():
    peaks = {p.name: p for p in _report().peaks}
    assert peaks["force"].largest == 50.0
    assert peaks["force"].limit == INFO.limits.force_n
    assert peaks["force_raw"].limit is None


def test_a_diverged_episode_is_left_out_of_the_peaks_and_counted():
    seed = _seed(0, [0, 0, 0, FailureReason.DIVERGED])
    seed.peaks[3] = np.nan
    report = _report(seeds=[seed])
    force = report.peaks[0]
    assert force.not_finite == 1
    assert force.largest == pytest.approx(50 / 3)
    assert report.reasons == {"success": 3, "diverged": 1}
    json.dumps(report.content(), allow_nan=False)


def test_parameters_that_decide_come_first_and_constant_ones_are_left_out():
    seed = _seed(0, [0] * 400, config=dataclasses.replace(RandomizationConfig(), push_n=(0.0, 0.0)))
    slow = seed.params[:, COLUMNS.index("gripper_latency_s")] > 0.9
    codes = np.where(slow, FailureReason.GOAL_NOT_REACHED, 0).astype(np.int64)
    report = _report(seeds=[dataclasses.replace(seed, codes=codes)])
    assert report.parameters[0].name == "gripper_latency_s"
    assert report.parameters[0].bins[-1].success.value == 0.0
    assert not any(p.name.startswith("push_") and p.name.endswith("_n") for p in report.parameters)


def test_report_json_round_trip(tmp_path):
    report = _report(videos=("videos/success.mp4",))
    json_path, _ = write_report(report, tmp_path)
    content = json.loads(json_path.read_text())
    assert content == report.content()
    assert content["success_rate"] == pytest.approx(report.success_rate)
    assert content["seeds"][0]["success"]["low"] == pytest.approx(report.seeds[0].success.low, 1e-5)
    assert content["curves"][0]["success"][0] is None  # JSON knows no NaN
    assert content["info"]["command"] == INFO.command
    assert len(content["timelines"][1]["force_n"]) == 200


def test_the_page_holds_the_figures_and_how_to_repeat_them(tmp_path):
    _, html_path = write_report(_report(), tmp_path, poster=PNG)
    page = html.unescape(html_path.read_text())
    for text in (
        "85.0\N{NO-BREAK SPACE}%",
        "force on the gripper too high: 6, median time 3.0 s",
        INFO.command,
    ):
        assert text in page
    for text in ("Success by seed", "Fastest joint", "Success by parameter", "3.9.0", "0123abc"):
        assert text in page
    assert "data:image/png;base64," in page
    assert "nan" not in page
    assert not re.search(r'(src|href)="https?:', page)


def test_the_page_reports_what_was_sampled_for_the_episodes_that_it_shows(tmp_path):
    page = report_page(_report(), tmp_path)
    fold = page[page.index("Sampled parameters") :].partition("</details>")[0]
    friction = sample_episode_params(RandomizationConfig(), np.random.default_rng(3))["friction"][0]
    assert f'finger friction, factor</td><td class="n">{friction:.3g}</td>' in fold
    assert len(re.findall("<tr>", fold)) == 1 + len(COLUMNS)


def test_the_page_stays_small(tmp_path):
    _, html_path = write_report(_report(), tmp_path, poster=PNG)
    assert html_path.stat().st_size < 150_000


def test_a_image_that_would_make_the_page_too_large_is_left_out(tmp_path):
    _, html_path = write_report(_report(), tmp_path, poster=PNG + bytes(MAX_POSTER_BYTES))
    assert html_path.stat().st_size < 150_000
    assert "data:image/png" not in html_path.read_text()


def test_hostile_names_are_only_text(tmp_path):
    evil = '"><script>alert(1)</script>`<img src=x onerror=y>'
    info = dataclasses.replace(
        INFO, name=evil, asset=evil, joint=evil, command=evil, config=evil, versions={evil: evil}
    )
    _, html_path = write_report(_report(info, videos=(f"videos/{evil}.mp4",)), tmp_path)
    page = html_path.read_text()
    assert "<script" not in page
    assert "<img" not in page
    assert "&lt;script&gt;" in page


def test_videos_are_referred_to_beside_the_page_or_put_into_it_when_requested(tmp_path):
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "failure.mp4").write_bytes(b"\0\0\0\x20ftypisom")
    report = _report(videos=("videos/failure.mp4",))
    assert 'src="videos/failure.mp4#t=0.05"' in report_page(report, tmp_path)
    assert "Failure: force on the gripper too high" in report_page(report, tmp_path)
    assert 'src="data:video/mp4;base64,' in report_page(report, tmp_path, embed_videos=True)


def test_the_page_can_be_passed_on_only_as_far_as_its_videos_are_small(tmp_path):
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "success.mp4").write_bytes(b"\0\0\0\x20ftypisom")
    (tmp_path / "videos" / "failure.mp4").write_bytes(bytes(MAX_EMBEDDED_BYTES + 1))
    report = _report(videos=("videos/success.mp4", "videos/failure.mp4"))
    page = write_report(report, tmp_path)[1].read_text()
    assert page.count('src="data:video/mp4;base64,') == 1
    assert page.count('src="videos/failure.mp4') == 1


def test_a_training_too_short_for_figures_has_no_empty_charts(tmp_path):
    nothing = np.zeros(0)
    short = Curve(seed=0, steps=nothing, success=nothing, opened=nothing,
                  reward_terms=np.zeros((0, len(TERMS))))  # fmt: skip
    info = dataclasses.replace(INFO, seconds=0.0, steps_per_s=0.0)
    report = dataclasses.replace(_report(info), curves=(short,))
    page = report_page(report, tmp_path)
    assert "too short for learning curves" in page
    assert "steps per second" not in page


def test_a_perfect_run_without_curves_videos_or_nominal_episodes_still_has_a_page(tmp_path):
    seed = _seed(3, [0] * 20, nominal=(), config=NO_RANDOMIZATION)
    report = _report(seeds=[seed], curves=False, timelines=False)
    assert report.nominal_success_rate is None
    assert report.parameters == ()
    page = report_page(report, tmp_path)
    assert "No failures: all 20 episodes succeeded." in page
    assert "No videos: " in page
