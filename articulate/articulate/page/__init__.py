"""One-file HTML pages with text, tables, charts, images and videos; they open offline."""

from articulate.page.chart import Bars, Chart, ChartLine, Points
from articulate.page.page import Page, Tile

__all__ = ["Bars", "Chart", "ChartLine", "Page", "Points", "Tile"]
