import re
import struct
import zlib
from html.parser import HTMLParser

import numpy as np
import pytest
from tests.articulate.asset_page.browser import Browser

from articulate.page import Bars, Chart, ChartLine, Page, Points, Tile

VOID = {"meta", "img", "br"}


class Checker(HTMLParser):
    """Fails where tags do not nest, and collects text and addresses."""

    def __init__(self):
        super().__init__()
        self.open: list[str] = []
        self.text = ""
        self.addresses: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.addresses += [value for name, value in attrs if name in {"src", "href"}]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def checked(page):
    checker = Checker()
    checker.feed(page.html())
    assert checker.open == []
    return checker


def png():
    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0)
    body = zlib.compress(b"\0\0\0\0")
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")
    )


def whole_page():
    x = np.linspace(0.0, 2e6, 5)
    return (
        Page("Run 7", "Three seeds.")
        .tiles(Tile(value=0.965, label="success", tone="good"), Tile(value=None, label="nothing"))
        .section("Learning", "Success means `opened` and deployable.")
        .charts(
            Chart(
                title="Success",
                marks=[ChartLine(name="a", x=x, y=x), ChartLine(name="b", x=x, y=-x)],
                goal=1.0,
            ),
            Chart(title="Friction", marks=[Points(name="p", x=x, y=x, low=x - 1, high=x + 1)]),
            Chart(title="Reasons", marks=Bars(labels=["force", "speed"], values=[2.0, 0.0])),
        )
        .table(["seed", "note"], [(0, "fine"), (1, None)], "Per seed")
        .pairs({"task": "open_drawer", "fast": True})
        .code("articulate train")
        .png(png(), "A picture")
        .mp4(b"\0\0\0\x18ftypisom", "A clip")
        .footer("articulate evaluate runs/7", {"mujoco": "3.9.0"})
    )


def test_page_is_well_formed_and_says_everything_it_was_given():
    text = checked(whole_page()).text
    for word in [
        "Run 7",
        "Three seeds.",
        "0.965",
        "Learning",
        "opened",
        "Reasons",
        "force",
        "Per seed",
    ]:
        assert word in text
    for word in [
        "open_drawer",
        "yes",
        "A picture",
        "A clip",
        "articulate evaluate runs/7",
        "mujoco 3.9.0",
    ]:
        assert word in text


def test_page_needs_nothing_but_itself():
    page = whole_page()
    assert all(address.startswith("data:") for address in checked(page).addresses)
    assert not re.search(r"https?:|@import|url\(|<script|<link", page.html())


def test_page_fits_a_phone_and_follows_light_and_dark():
    html = whole_page().html()
    assert "width=device-width" in html
    assert "prefers-color-scheme: dark" in html
    assert "@media print" in html


def test_everything_is_escaped():
    evil = '<script>alert("x")</script>&amp;\''
    page = (
        Page(evil, evil)
        .section(evil, evil)
        .text(f"`{evil}`")
        .code(evil)
        .tiles(Tile(value=evil, label=evil))
        .table([evil], [(evil,)], evil)
        .pairs({evil: evil}, evil)
        .charts(
            Chart(
                title=evil, caption=evil, x_label=evil, y_label=evil,
                marks=[ChartLine(name=evil, x=[0, 1], y=[0, 1]), Points(name=evil, x=[0], y=[0])],
            ),
            Chart(title=evil, marks=Bars(labels=[evil], values=[1.0])),
        )
        .png(png(), evil)
        .mp4(b"\0\0\0\x18ftyp", evil)
        .footer(evil, {evil: evil})
    )  # fmt: skip
    assert "<script" not in page.html()
    assert checked(page).text.count(evil) >= 15


def test_odd_backquote_stays_a_backquote():
    assert "a ` b" in checked(Page("t").text("a ` b")).text


def test_row_of_another_length_than_the_header_is_a_bug_that_is_named():
    with pytest.raises(ValueError, match="has 1 cells; the header has 2"):
        Page("t").table(["a", "b"], [(1,)])


def test_columns_of_numbers_are_set_to_the_right():
    html = Page("t").table(["n", "word"], [(1, "x"), (None, "y")]).html()
    assert '<td class="n">1</td><td>x</td>' in html


@pytest.mark.parametrize("add", [Page.png, Page.mp4])
def test_file_of_another_kind_is_refused(add):
    with pytest.raises(ValueError, match="not the expected kind"):
        add(Page("t"), b"GIF89a", "x")


@pytest.mark.render
def test_long_key_figures_fit_on_a_phone(tmp_path):
    tiles = [Tile(value="StorageFurnitureWithDoors", label="category"), Tile(value=2, label="n")]
    path = Page("t").tiles(*tiles).save(tmp_path / "page.html")
    with Browser(width=390, height=844, phone=True) as browser:
        browser.open(path)
        assert browser.run("document.documentElement.scrollWidth") == 390


def test_page_is_saved_whole_and_the_same_each_time(tmp_path):
    path = whole_page().save(tmp_path / "report.html")
    assert path.read_text(encoding="utf-8") == whole_page().html()
