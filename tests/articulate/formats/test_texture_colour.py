from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from articulate.errors import AssetError
from articulate.formats import texture_colour
from articulate.formats.texture_colour import mean_colour


def test_colour_is_the_mean_of_the_picture(tmp_path: Path) -> None:
    image = Image.new("RGB", (16, 16), (255, 0, 0))
    image.paste((0, 0, 255), (0, 0, 8, 16))
    image.save(tmp_path / "half.png")
    assert mean_colour(tmp_path / "half.png") == pytest.approx((0.5, 0.0, 0.5), abs=0.01)


def test_palette_with_transparency_is_read_without_a_warning(tmp_path: Path) -> None:
    image = Image.new("P", (8, 8), 1)
    image.putpalette([0, 0, 0, 0, 255, 0] + 254 * [0, 0, 0])
    image.save(tmp_path / "p.png", transparency=b"\x00\xff")
    assert mean_colour(tmp_path / "p.png") == pytest.approx((0.0, 1.0, 0.0))


def test_damaged_picture_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.png").write_bytes(b"\x89PNG\r\n\x1a\nnothing")
    with pytest.raises(AssetError, match=r"texture bad\.png: cannot be read"):
        mean_colour(tmp_path / "bad.png")


def test_huge_picture_is_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.new("RGB", (20, 20)).save(tmp_path / "big.png")
    monkeypatch.setattr(texture_colour, "MAX_PIXELS", 100)
    with pytest.raises(AssetError, match="more than 100 pixels"):
        mean_colour(tmp_path / "big.png")
