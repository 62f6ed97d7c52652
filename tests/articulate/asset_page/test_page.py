"""The page of a proof says what was found, needs no other file and survives what it is given."""

from __future__ import annotations

import re
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from tests.articulate.asset_page.browser import Browser
from tests.articulate.checks.objects import Part, make_object
from tests.assets import make_cabinet

from articulate.asset_page.images import SIZE, THUMBNAIL_SIZE, render_images
from articulate.asset_page.index import IndexRow, write_index
from articulate.asset_page.page import amount, bound, verdict_text, write_page
from articulate.assets.check_report import Check, CheckReport, Counts, JointCheck
from articulate.checks.model import load_model

MOST_BYTES = 3_000_000


def check_report_of(shown, verdict="passed", **changes):
    joints = tuple(
        JointCheck(
            name=j.name, kind=j.kind, span=j.span, swept=1.0, blocked=False, needs=(), opened=1.0
        )
        for j in shown.joints
    )
    checks = tuple(
        Check(
            name="joint_sweep",
            outcome="passed",
            subject=j.name,
            measured=0.0002 * (k + 1),
            allowed=0.002,
            unit="m",
            message=f"{j.name} goes through its range",
        )
        for k, j in enumerate(shown.joints)
    )
    told = {
        "asset": shown.name,
        "verdict": verdict,
        "checks": checks,
        "joints": joints,
        "counts": Counts(links=(6, 4), joints=(3, 3), visuals=(9, 9), collisions=(8, 21)),
        "source": "made for tests",
        "licence": "MIT",
        "colliders": 21,
        "seconds": 2.0,
    }
    return CheckReport(**{**told, **changes})


@pytest.fixture
def no_driver(monkeypatch):
    """No library draws here."""
    monkeypatch.setenv("MUJOCO_GL", "none_of_them")


@pytest.fixture
def cabinet(tmp_path):
    return make_cabinet(tmp_path / "cabinet")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.002, "m", "2 mm"),
        (-0.25, "m", "−250 mm"),
        (0.985, "1", "98.5 %"),
        (1e-6, "m or rad", "1e−6 m or rad"),
        (1.5707963, "rad", "90°"),
        (None, "m", ""),
    ],
)
def test_amounts_read_as_people_write_them(value, unit, text):
    assert amount(value, unit).replace("\u202f", " ") == text


@pytest.mark.parametrize(
    ("measured", "outcome", "sign"),
    [(1.0, "passed", "≤"), (3.0, "failed", "≤"), (3.0, "passed", "≥"), (1.0, "failed", "≥"),
     (2.0, "passed", "")],
)  # fmt: skip
def test_outcomes_tell_how_measured_and_allowed_are_compared(measured, outcome, sign):
    check = Check(name="a", outcome=outcome, measured=measured, allowed=2.0)
    assert bound([Check(name="a", outcome="not_applicable"), check]) == sign


def test_verdicts_are_said_in_words(cabinet):
    assert verdict_text(check_report_of(cabinet)) == (
        "Passed",
        "All 3 measurements passed. Nothing had to be repaired.",
    )
    repaired = check_report_of(cabinet, "repaired", repairs=("a", "b"))
    assert verdict_text(repaired)[0] == "Passed after 2 repairs"
    rigid = check_report_of(cabinet, joints=())
    assert "no movable joint and was checked as a rigid object" in verdict_text(rigid)[1]
    unread = check_report_of(cabinet, "rejected", checks=(), reasons=("no mesh",))
    assert verdict_text(unread) == ("Rejected", "It was not measured:")


def test_page_holds_everything_and_needs_nothing(cabinet, tmp_path, no_driver):
    path = tmp_path / "check_report.html"
    write_page(check_report_of(cabinet, "repaired", repairs=("axis turned",)), cabinet, path)
    text = path.read_text(encoding="utf-8")
    for said in ("Passed after 1 repair", "axis turned", "made for tests", "MIT", "drawer_2_slide"):
        assert said in text
    assert len(text.encode()) < MOST_BYTES
    assert text.count("Copyright 2010-2023 Three.js Authors") == 1
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert re.findall(r'(?:src|href)="(?!data:)[^"]*"', own) == []
    assert "@import" not in own
    assert "url(" not in own


def test_page_without_a_driver_says_that_it_has_no_pictures(cabinet, tmp_path, no_driver):
    path = tmp_path / "check_report.html"
    write_page(check_report_of(cabinet), cabinet, path)
    text = path.read_text(encoding="utf-8")
    assert "No images: " in text
    assert "data:image" not in text
    assert 'id="viewer"' in text
    assert not path.with_suffix(".webp").exists()


def test_failures_come_first_and_the_least_clear_success_is_shown(cabinet, tmp_path, no_driver):
    bad = Check(
        name="opening",
        outcome="failed",
        subject="drawer_1_slide",
        measured=0.4,
        allowed=0.9,
        unit="1",
        message="stops at 40 %",
    )
    check_report = check_report_of(
        cabinet, "rejected", reasons=("open, joint drawer_1_slide: stops at 40 %",)
    )
    check_report = check_report_of(
        cabinet, "rejected", reasons=check_report.reasons, checks=(*check_report.checks, bad)
    )
    path = tmp_path / "check_report.html"
    write_page(check_report, cabinet, path, meanings={"opening": "A hand opens it."})
    text = path.read_text(encoding="utf-8").replace("\u202f", " ").replace("&nbsp;", " ")
    table = text[text.index("<h2>Checks") : text.index("All 4 measurements")]
    assert table.index("stops at 40 %") < table.index("drawer_2_slide goes through its range")
    assert "drawer_0_slide goes" not in table
    assert "A hand opens it." in table
    assert "≥ 90 %" in table
    assert "0.6 mm" in table
    assert "≤ 2 mm" in table


def test_names_from_a_file_are_text_and_never_elements(cabinet, tmp_path, no_driver):
    evil = "<img src=x onerror=alert(1)>"
    check = Check(name=evil, outcome="failed", subject=evil, message=evil)
    joint = JointCheck(name=evil, kind="slide", span=1.0, swept=0.0, blocked=True, needs=(evil,))
    check_report = check_report_of(
        cabinet,
        "rejected",
        asset=evil,
        reasons=(evil,),
        repairs=(evil,),
        source=evil,
        checks=(check,),
        joints=(joint,),
    )
    write_page(check_report, cabinet, tmp_path / "check_report.html", meanings={evil: evil})
    write_index([IndexRow(check_report=check_report, category=evil)], tmp_path / "index.html")
    for name in ("check_report.html", "index.html"):
        assert "<img src=x" not in (tmp_path / name).read_text(encoding="utf-8")


def test_what_could_not_be_read_gets_a_page_with_the_reason(tmp_path):
    check_report = CheckReport(
        asset="lost", verdict="rejected", reasons=("lost.urdf: mesh a.obj not found",)
    )
    write_page(check_report, None, tmp_path / "check_report.html")
    text = (tmp_path / "check_report.html").read_text(encoding="utf-8")
    assert "mesh a.obj not found" in text
    assert "THREE" not in text


def test_a_broken_model_costs_the_view_and_not_the_page(cabinet, tmp_path):
    cabinet.mjcf_path.write_text("<mujoco><worldbody>", encoding="utf-8")
    write_page(check_report_of(cabinet), cabinet, tmp_path / "check_report.html")
    text = (tmp_path / "check_report.html").read_text(encoding="utf-8")
    assert "There is no 3-D view and no image" in text
    assert "not XML" in text


def test_list_shows_refused_first_and_links_to_pages(cabinet, tmp_path):
    rows = []
    for name, verdict in (("b", "passed"), ("a", "repaired"), ("c", "rejected")):
        page = tmp_path / "out" / f"{name} 1" / "check_report.html"
        page.parent.mkdir(parents=True)
        page.write_text("", encoding="utf-8")
        Image.new("RGB", (8, 8)).save(page.with_suffix(".webp"))
        check_report = check_report_of(
            cabinet, verdict, asset=name, reasons=("too tight",) * (verdict == "rejected")
        )
        rows.append(IndexRow(check_report=check_report, category="Safe", page=page))
    write_index(rows, tmp_path / "out" / "index.html")
    text = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert re.findall(r'href="([^"]*)"', text) == [
        "c%201/check_report.html",
        "a%201/check_report.html",
        "b%201/check_report.html",
    ]
    assert text.count("data:image/webp") == 3
    assert "2 of 3 objects passed" in text
    assert "too tight" in text


def test_an_empty_list_is_a_page_too(tmp_path):
    write_index([], tmp_path / "index.html")
    assert "0 of 0 objects" in (tmp_path / "index.html").read_text(encoding="utf-8")


@pytest.mark.render
def test_pictures_show_each_joint_open_and_the_collision_shapes(cabinet):
    rendered = render_images(load_model(cabinet), {"drawer_0_slide": ("drawer_1_slide",)})
    pictures = [Image.open(BytesIO(p.webp)).convert("L") for p in rendered.in_order]
    assert [image.size for image in pictures] == [SIZE] * 6
    assert Image.open(BytesIO(rendered.thumbnail)).size == THUMBNAIL_SIZE
    assert rendered.opened[0].caption == "drawer_0_slide open by 280 mm, with drawer_1_slide open"
    contents = {image.tobytes() for image in pictures}
    assert len(contents) == 6  # no two alike
    assert np.ptp(np.asarray(pictures[0])) > 60  # something stands out


@pytest.mark.render
def test_page_carries_the_pictures_and_leaves_a_small_one_beside_it(tmp_path):
    lid = Part(
        name="lid", kind="hinge", axis=(0, 1, 0), boxes=(((0.2, 0, 0.3), (0.1, 0.05, 0.02)),)
    )
    asset = make_object(tmp_path / "a", lid)
    write_page(check_report_of(asset), asset, tmp_path / "check_report.html")
    text = (tmp_path / "check_report.html").read_text(encoding="utf-8")
    assert text.count("data:image/webp") == 3  # closed, the lid open, collision shapes
    assert Image.open(tmp_path / "check_report.webp").size == THUMBNAIL_SIZE


@pytest.mark.render
def test_the_list_sorts_and_filters_in_a_browser(cabinet, tmp_path):
    rows = [
        IndexRow(check_report=check_report_of(cabinet, verdict, asset=name, seconds=seconds))
        for name, verdict, seconds in (
            ("b", "passed", 2.0),
            ("a", "passed", 10.0),
            ("c", "rejected", 3.0),
        )
    ]
    write_index(rows, tmp_path / "index.html")
    shown = (
        "[...document.querySelectorAll('tbody tr')].filter(r => !r.hidden)"
        ".map(r => r.cells[1].innerText).join('')"
    )
    with Browser(width=900, height=400) as browser:
        browser.open(tmp_path / "index.html")
        assert browser.run(shown) == "cab"
        browser.run("document.querySelector('th[data-column=\"7\"] button').click()")
        assert browser.run(shown) == "bca"
        browser.run("document.querySelector('[data-verdict=passed]').click()")
        assert browser.run(shown) == "ba"
        assert browser.problems == []
