"""Appearance and density of parts: a colour and a small image that repeats over the surface."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array

Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, each in [0, 1]."""
Grain = Literal["", "wood", "brushed", "fabric", "speckle"]
SIDE = 96
"""Side of an image [px]."""


@dataclass(frozen=True, kw_only=True)
class Material:
    """Colour, texture and density of a material."""

    rgba: Colour
    """Mean colour."""
    grain: Grain = ""
    """Kind of texture; none if empty."""
    tile_m: float = 0.3
    """Length of the image on the surface [m]."""
    density_kg_m3: float = 1000.0
    """Density of a part of it, cavities included [kg/m^3]."""


def _material(
    r: float, g: float, b: float, grain: Grain, density_kg_m3: float, tile_m: float = 0.3
) -> Material:
    return Material(rgba=(r, g, b, 1.0), grain=grain, density_kg_m3=density_kg_m3, tile_m=tile_m)


PALETTE: dict[str, Material] = {
    "oak": _material(0.72, 0.55, 0.36, "wood", 650.0, 0.5),
    "walnut": _material(0.42, 0.29, 0.20, "wood", 650.0, 0.5),
    "birch": _material(0.85, 0.76, 0.60, "wood", 600.0, 0.5),
    "white_lacquer": _material(0.91, 0.91, 0.89, "speckle", 650.0),
    "white_sheet": _material(0.92, 0.93, 0.94, "speckle", 300.0),
    "liner": _material(0.83, 0.87, 0.90, "speckle", 120.0),
    "steel": _material(0.66, 0.68, 0.70, "brushed", 300.0, 0.2),
    "dark_steel": _material(0.27, 0.29, 0.31, "brushed", 300.0, 0.2),
    "chrome": _material(0.78, 0.80, 0.82, "brushed", 2700.0, 0.1),
    "brass": _material(0.75, 0.60, 0.30, "brushed", 2700.0, 0.1),
    "black_plastic": _material(0.12, 0.12, 0.13, "speckle", 950.0, 0.2),
    "grey_plastic": _material(0.48, 0.50, 0.52, "speckle", 950.0, 0.2),
    "white_plastic": _material(0.90, 0.90, 0.88, "speckle", 950.0, 0.2),
    "red_plastic": _material(0.72, 0.16, 0.14, "speckle", 950.0, 0.2),
    "blue_plastic": _material(0.16, 0.34, 0.62, "speckle", 950.0, 0.2),
    "green_plastic": _material(0.20, 0.48, 0.30, "speckle", 950.0, 0.2),
    "rubber": _material(0.10, 0.10, 0.10, "speckle", 1100.0, 0.1),
    "ceramic": _material(0.95, 0.95, 0.93, "", 1500.0),
    "fabric": _material(0.20, 0.24, 0.32, "fabric", 150.0, 0.08),
    "glass": Material(rgba=(0.62, 0.76, 0.80, 0.35), density_kg_m3=2500.0),
    "dark_glass": _material(0.07, 0.08, 0.10, "", 2500.0),
    "screen": _material(0.10, 0.20, 0.38, "", 1200.0),
    "pine": _material(0.87, 0.72, 0.48, "wood", 520.0, 0.5),
    "beech": _material(0.80, 0.62, 0.45, "wood", 680.0, 0.5),
    "maple": _material(0.86, 0.72, 0.54, "wood", 650.0, 0.5),
    "cherry": _material(0.60, 0.33, 0.22, "wood", 600.0, 0.5),
    "mahogany": _material(0.42, 0.20, 0.14, "wood", 600.0, 0.5),
    "teak": _material(0.58, 0.42, 0.26, "wood", 650.0, 0.5),
    "ash": _material(0.79, 0.70, 0.57, "wood", 680.0, 0.5),
    "bamboo": _material(0.84, 0.71, 0.45, "wood", 650.0, 0.5),
    "copper": _material(0.72, 0.45, 0.30, "brushed", 2700.0, 0.1),
    "leather": _material(0.30, 0.19, 0.13, "speckle", 300.0, 0.1),
}
"""Materials by name."""
COLOURS: dict[str, tuple[float, float, float]] = {
    "white": (0.91, 0.91, 0.89),
    "beige": (0.87, 0.81, 0.70),
    "black": (0.12, 0.12, 0.13),
    "grey": (0.48, 0.50, 0.52),
    "red": (0.72, 0.16, 0.14),
    "blue": (0.16, 0.34, 0.62),
    "green": (0.20, 0.48, 0.30),
    "yellow": (0.92, 0.76, 0.20),
    "orange": (0.88, 0.46, 0.14),
    "brown": (0.40, 0.27, 0.18),
    "pink": (0.88, 0.58, 0.66),
    "purple": (0.42, 0.26, 0.54),
}
"""Red, green and blue of common colours, each in [0, 1]."""
SURFACES = {"lacquer": 650.0, "sheet": 300.0, "plastic": 950.0}
"""Density of painted board, painted sheet metal and plastic [kg/m^3]."""
PALETTE |= {
    f"{colour}_{surface}": _material(*rgb, "speckle", density)
    for surface, density in SURFACES.items()
    for colour, rgb in COLOURS.items()
    if f"{colour}_{surface}" not in PALETTE
}


def texture(name: str, material: Material) -> bytes:
    """Return a seamless PNG of the grain of a material whose mean is the colour.

    The same name gives the same image.
    """
    rng = np.random.default_rng(list(name.encode()))
    shade = _GRAINS[material.grain](rng)
    shade = shade - shade.mean()
    pixels = np.clip(np.array(material.rgba[:3]) * (1.0 + shade[..., None]), 0.0, 1.0)
    return _png(np.round(255.0 * pixels).astype(np.uint8))


def _png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode pixels (height, width, 3) as PNG."""
    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)  # 0: no filter
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)  # 8 bits, colour
    out = b"\x89PNG\r\n\x1a\n"
    for tag, data in ((b"IHDR", head), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b"")):
        body = tag + data
        out += struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
    return out


def _waves(rng: np.random.Generator, across: tuple[int, int], along: tuple[int, int]) -> Array:
    """Sum of twelve waves with integer numbers of periods down and along an image."""
    v, u = np.meshgrid(np.arange(SIDE) / SIDE, np.arange(SIDE) / SIDE, indexing="ij")
    total = np.zeros((SIDE, SIDE))
    for _ in range(12):
        m, n = rng.integers(*across), rng.integers(*along)
        phase, size = rng.uniform(0.0, 2.0 * np.pi), 1.0 / np.sqrt(abs(m) + 1.0)
        total += size * np.sin(2.0 * np.pi * (m * v + n * u) + phase)
    return np.asarray(total / np.abs(total).max())


def _wood(rng: np.random.Generator) -> Array:
    """Slightly bent streaks along the image with dark pores."""
    streaks = _waves(rng, (2, 22), (-1, 2))
    pores = _waves(rng, (20, 46), (-2, 3))
    return 0.13 * streaks - 0.12 * (np.abs(pores) < 0.06)


def _brushed(rng: np.random.Generator) -> Array:
    """Fine scratches along the image."""
    lines = rng.normal(size=(SIDE, 1)) * np.ones((1, SIDE))
    return 0.03 * lines + 0.015 * rng.normal(size=(SIDE, SIDE))


def _fabric(rng: np.random.Generator) -> Array:
    """Return a plain weave."""
    v, u = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    over = np.where(
        (u // 6 + v // 6) % 2 == 0, np.sin(np.pi * (u % 6) / 5), np.sin(np.pi * (v % 6) / 5)
    )
    return 0.35 * over + 0.05 * rng.normal(size=(SIDE, SIDE))


def _speckle(rng: np.random.Generator) -> Array:
    """Return the dull surface of lacquer and plastics."""
    return np.asarray(0.02 * rng.normal(size=(SIDE, SIDE)))


_GRAINS: dict[str, Callable[[np.random.Generator], Array]] = {
    "wood": _wood,
    "brushed": _brushed,
    "fabric": _fabric,
    "speckle": _speckle,
}
