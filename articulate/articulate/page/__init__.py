"""One-file HTML pages: text, tables, charts, pictures and clips that open anywhere, offline."""

from articulate.page.chart import Bars, Chart, Line, Points
from articulate.page.page import Page, Tile
from articulate.page.violin import Violins

__all__ = ["Bars", "Chart", "Line", "Page", "Points", "Tile", "Violins"]
