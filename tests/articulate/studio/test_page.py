"""Scripted use of the page in a headless Chromium."""

from __future__ import annotations

import json

import pytest
from tests.articulate.asset_page.browser import Browser
from tests.articulate.studio.objects import write_cupboard
from tests.articulate.studio.test_server import NoChecker

from articulate.studio.server import StudioServer
from articulate.studio.session import Session
from articulate.studio.source import read_studio_source

pytestmark = [pytest.mark.render, pytest.mark.slow]


@pytest.fixture
def session(tmp_path):
    source = read_studio_source(write_cupboard(tmp_path / "in"))
    checker = NoChecker(tmp_path / "cache", 60.0, dict(source.licence))
    made = Session(source=source, out=tmp_path / "out", checker=checker)
    yield made
    made.close()


def opened(browser, server):
    server.start()
    browser.send("Page.navigate", url=server.url)
    browser.wait("!!window.studio && studio.view.triangles() > 0")


def click(browser, selector):
    browser.run(f"document.querySelector({json.dumps(selector)}).click()")


def at(browser, part, point):
    return browser.run(f"studio.view.screen({json.dumps(part)}, {point})")


def test_a_person_corrects_axis_limits_and_parts(session):
    with StudioServer(session) as server, Browser(width=1280, height=800) as browser:
        opened(browser, server)
        click(browser, '[data-candidate="slide out"]')
        browser.wait("studio.state().history.length === 1")
        assert session.model.joint("door").kind == "prismatic"
        click(browser, '[data-mode="edge"]')
        edge = at(browser, "door", [-0.22, -0.299, 0.3])
        browser.drag(tuple(edge), tuple(edge), steps=1)
        browser.wait("studio.state().history.length === 2")
        hinge = session.model.joint("door")
        assert hinge.kind == "revolute"
        assert abs(hinge.axis_o[2]) == 1.0
        assert hinge.pivot_o[1] == pytest.approx(-0.3)
        handle = browser.run("studio.view.handle('upper')")
        goal = browser.run("studio.view.handle('upper', 1.2)")
        browser.drag(tuple(handle), tuple(goal), steps=12)
        browser.wait("studio.state().history.length === 3")
        assert session.model.joint("door").upper == pytest.approx(1.2, abs=0.03)
        browser.run("studio.view.setPosition('door', 0)")
        click(browser, '[data-mode="paint"]')
        knob = at(browser, "door", [-0.25, -0.25, 0.4])
        browser.drag(tuple(knob), tuple(knob), steps=1)
        click(browser, "#make-part")
        browser.wait("studio.state().parts.length === 3")
        assert session.model.joint("door_2").parent == "door"
        click(browser, "#undo")
        browser.wait("studio.state().parts.length === 2")
        assert browser.problems == []
        server.shutdown()


def test_a_phone_shows_the_object_without_the_editor(session):
    with StudioServer(session) as server, Browser(width=390, height=844, phone=True) as browser:
        opened(browser, server)
        assert browser.run("document.documentElement.scrollWidth") == 390
        assert not browser.run("!!document.querySelector('.desk').offsetParent")
        browser.run(
            "(() => { const e = document.querySelector('[data-slider=door]'); e.value = 1;"
            "e.dispatchEvent(new Event('input')); })()"
        )
        assert browser.run("studio.view.position('door')") == 1.0
        assert browser.problems == []
        server.shutdown()
