"""The page of a report as a browser shows it: on a phone, on a desk, in the dark and on paper."""

import dataclasses

import pytest
from tests.articulate.asset_page.browser import Browser
from tests.articulate_train.test_report import INFO, PNG, _report

from articulate_train.report_html import write_report

WIDE = """[...document.querySelectorAll("{what}")].filter(
  e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent.slice(0, 60))"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "videos").mkdir()
    (folder / "videos" / "failure.mp4").write_bytes(b"\0\0\0\x20ftypisom")
    info = dataclasses.replace(
        INFO,
        command="train --asset 'my objects/cabinet.urdf' --task open_drawer --joint drawer_0_slide "
        "--seeds 0 1 2 --steps 2000000 --set randomization.mass=0.5,2.0 --episodes 20",
        versions={"system": "Linux-6.18.44-some-v595-x86_64-with-glibc2.36"},
    )
    report = _report(info, videos=("videos/failure.mp4",))
    return write_report(report, folder, poster=PNG)[1]


@pytest.mark.render
@pytest.mark.parametrize(("width", "phone"), [(360, True), (1200, False)])
def test_nothing_is_cut_off(page, width, phone):
    with Browser(width=width, height=800, phone=phone) as browser:
        browser.open(page)
        assert browser.run("document.documentElement.scrollWidth") == width
        assert browser.run(WIDE.format(what="pre, .tile")) == []
        assert browser.run(WIDE.format(what=".scroll:not(details *)")) == []


@pytest.mark.render
def test_it_is_dark_where_readers_want_it_dark_and_light_on_paper(page):
    colour = "getComputedStyle(document.body).backgroundColor"
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    with Browser(width=720, height=1000) as browser:  # about the width of a page
        browser.open(page)
        light = browser.run(colour)
        browser.send("Emulation.setEmulatedMedia", features=dark)
        assert browser.run(colour) != light
        browser.send("Emulation.setEmulatedMedia", media="print", features=dark)
        assert browser.run(colour) == "rgb(255, 255, 255)"
        assert browser.run(WIDE.format(what="pre, .tile, .scroll:not(details *)")) == []
