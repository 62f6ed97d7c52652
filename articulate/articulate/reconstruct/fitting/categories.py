"""Usual sizes of categories, and generated objects from the measurements of an image."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from articulate.library.procedural.categories import CATEGORIES
from articulate.library.procedural.dimensions import Dimensions
from articulate.library.procedural.front_layout import (
    MIN_FRONT_M,
    MOVING,
    FrontLayout,
    FrontPanel,
    least_front_m,
)
from articulate.library.procedural.urdf import Part
from articulate.reconstruct.fitting.box_fit import SizePrior
from articulate.reconstruct.fitting.front_panels import (
    certainty,
    fixed_if_small,
    panels_of,
    with_fixed,
)
from articulate.reconstruct.fitting.object_front import ObjectFront


@dataclass(frozen=True, kw_only=True)
class UsualSize:
    """Usual height [m], and width and depth over height."""

    height_m: float
    width: float
    depth: float
    spread: float = 0.35
    """Spread of the logarithms of the ratios."""
    slides: float = 0.05
    """Share of first motions that are a slide: drawers, sliding lids."""

    @property
    def prior(self) -> SizePrior:
        """Prior of a box fit."""
        return SizePrior(
            log_width=float(np.log(self.width)),
            log_depth=float(np.log(self.depth)),
            spread=self.spread,
        )


USUAL: Mapping[str, UsualSize] = {
    "Bottle": UsualSize(height_m=0.24, width=0.33, depth=0.33, spread=0.2, slides=0.4),
    "Box": UsualSize(height_m=0.26, width=1.5, depth=1.1),
    "Bucket": UsualSize(height_m=0.30, width=1.0, depth=1.0, spread=0.2),
    "Chair": UsualSize(height_m=1.0, width=0.6, depth=0.6, slides=0.1),
    "Dishwasher": UsualSize(height_m=0.85, width=0.71, depth=0.70, spread=0.15, slides=0.02),
    "Door": UsualSize(height_m=2.05, width=0.45, depth=0.06, slides=0.1),
    "Faucet": UsualSize(height_m=0.3, width=0.6, depth=0.6),
    "Kettle": UsualSize(height_m=0.22, width=1.0, depth=0.8),
    "KitchenPot": UsualSize(height_m=0.18, width=1.6, depth=1.2, slides=0.7),
    "Laptop": UsualSize(height_m=0.24, width=1.5, depth=1.2, slides=0.01),
    "Microwave": UsualSize(height_m=0.30, width=1.67, depth=1.25, spread=0.2, slides=0.02),
    "Oven": UsualSize(height_m=0.88, width=0.72, depth=0.70, spread=0.3, slides=0.03),
    "Refrigerator": UsualSize(height_m=1.7, width=0.42, depth=0.40, spread=0.3, slides=0.03),
    "Safe": UsualSize(height_m=0.45, width=0.95, depth=0.9, spread=0.3, slides=0.01),
    "StorageFurniture": UsualSize(height_m=0.85, width=0.95, depth=0.55, spread=0.5, slides=0.45),
    "Suitcase": UsualSize(height_m=0.65, width=0.7, depth=0.4, slides=0.6),
    "Switch": UsualSize(height_m=0.09, width=1.0, depth=0.3),
    "Table": UsualSize(height_m=0.75, width=1.6, depth=0.8, spread=0.4, slides=0.9),
    "Toilet": UsualSize(height_m=0.75, width=0.55, depth=0.9, slides=0.01),
    "TrashCan": UsualSize(height_m=0.6, width=0.65, depth=0.65, slides=0.1),
    "WashingMachine": UsualSize(height_m=0.85, width=0.71, depth=0.68, spread=0.12, slides=0.02),
    "Window": UsualSize(height_m=1.2, width=1.0, depth=0.1, slides=0.5),
}
"""Usual sizes by PartNet-Mobility's category; those that the library can generate."""
LIBRARY = {CATEGORIES[name].partnet: name for name in reversed(list(CATEGORIES))}
"""Procedural category of each of PartNet-Mobility's; the first of several."""
LAYOUTS = ("StorageFurniture", "Table", "Refrigerator", "Microwave", "Oven", "Dishwasher")
"""Categories whose front is generated from the parts in the image."""
STRUCTURES = ("hinges", "cap", "freezer", "handles", "kind")
"""Dimensions of a category that change its joints."""
WORKTOP_M = 0.018
"""Thickness of the worktop of furniture [m]."""
BOARD_M, FRIDGE_BOARD_M, OVEN_BOARD_M = 0.018, 0.05, 0.03
"""Thickness of walls and fronts of furniture, refrigerators, and ovens and dishwashers [m]."""
CONTROLS = (0.84, 0.95)
"""Lowest and highest edge of a control panel above a door, as a share of the front."""
PLINTH_M, COOKTOP_M = 0.05, 0.02
"""Height of the plinth and thickness of the worktop of an appliance [m]."""
LOW_DRAWER = 0.35
"""Highest edge of a drawer below a door, as a share of the front."""


@dataclass(frozen=True, kw_only=True)
class Generated:
    """Generated parts and what was assumed for them."""

    parts: tuple[Part, ...]
    assumptions: tuple[str, ...]
    layout: FrontLayout | None = None
    certainty: float | None = None
    """Certainty of the parts of the front, in [0, 1]; None where the category determines them."""
    dimensions: Dimensions | None = None
    """Dimensions of an object whose category determines its parts."""

    def alternatives(self) -> tuple[Generated, ...]:
        """Return the objects with the same dimensions and other structures of the category."""
        out = [self]
        dimensions = self.dimensions
        for field in dataclasses.fields(dimensions) if dimensions is not None else ():
            if field.name in STRUCTURES and "choices" in field.metadata:
                out = [one._chosen(field.name, c) for one in out for c in field.metadata["choices"]]
        return tuple(out)

    def _chosen(self, name: str, choice: str) -> Generated:
        assert self.dimensions is not None
        changes: dict[str, Any] = {name: choice}
        dimensions = dataclasses.replace(self.dimensions, **changes)
        return dataclasses.replace(self, dimensions=dimensions, parts=tuple(dimensions.parts()))


def generate(category: str, front: ObjectFront, height_m: float | None = None) -> Generated:
    """Return the object of a category with the proportions and the front of an image.

    Args:
        category: PartNet-Mobility's name, a key of ``USUAL``.
        front: Fitted box and its front.
        height_m: Height of the object [m]; None: the usual one of the category.
    """
    usual = USUAL[category]
    height = height_m or usual.height_m
    assumptions = []
    if height_m is None:
        assumptions.append(f"height {height:g} m: usual for the category; give --size if known")
    sizes = {
        "width_m": front.fit.width * height,
        "depth_m": float(np.clip(front.fit.depth, 0.25 * usual.depth, 3.0 * usual.depth)) * height,
        "height_m": height,
    }
    if category in LAYOUTS:
        layout = _LAYOUTS[category](front, sizes)
        free = category in {"StorageFurniture", "Table", "Refrigerator"}
        return Generated(
            parts=tuple(layout.parts()),
            assumptions=tuple(assumptions),
            layout=layout,
            certainty=certainty(front.parts) if free else None,
        )
    name = LIBRARY[category]
    dimensions = CATEGORIES[name].dimensions
    assert dimensions is not None
    found, clipped = scaled(dimensions, sizes)
    assumptions += [f"{field}: within the range of the category" for field in clipped]
    assumptions.append("parts and other dimensions: those of the category")
    return Generated(parts=tuple(found.parts()), assumptions=tuple(assumptions), dimensions=found)


def scaled(
    dimensions: type[Dimensions], sizes: Mapping[str, float]
) -> tuple[Dimensions, list[str]]:
    """Return the usual object of a category with other outer sizes, and the sizes out of range."""
    changes: dict[str, float] = {}
    clipped = []
    wanted = dict(sizes)
    wanted["radius_m"] = 0.25 * (sizes["width_m"] + sizes["depth_m"])
    for field in dataclasses.fields(dimensions):
        if field.name in wanted and "between" in field.metadata:
            low, high = field.metadata.get("accepted", field.metadata["between"])
            value = float(np.clip(wanted[field.name], low, high))
            if abs(value - wanted[field.name]) > 0.15 * wanted[field.name]:
                clipped.append(field.name)
            changes[field.name] = round(value, 3)
    return dataclasses.replace(dimensions.sample(0), **changes), clipped


def _storage(
    front: ObjectFront, sizes: Mapping[str, float], board_m: float = BOARD_M
) -> FrontLayout:
    """Return furniture with the parts of the front; it has one door where none is found."""
    most = sizes["height_m"] - WORKTOP_M - 1.05 * MIN_FRONT_M
    base = round(max(0.0, min(front.base_share * sizes["height_m"], most)), 3)
    width = round(max(0.15, sizes["width_m"]), 3)
    front_m = sizes["height_m"] - base - WORKTOP_M
    low, high = base / sizes["height_m"], 1.0 - WORKTOP_M / sizes["height_m"]
    panels, least = panels_of(front.parts, low, high), least_front_m(board_m)
    panels = tuple(fixed_if_small(panel, width, front_m, least) for panel in panels)
    if not any(panel.kind in MOVING for panel in panels):
        panels = (FrontPanel(kind="door", left=0.0, right=1.0, bottom=0.0, top=1.0, hinge="right"),)
    return FrontLayout(
        panels=with_fixed(panels, "panel", "panel"),
        width_m=width,
        depth_m=round(max(0.15, sizes["depth_m"]), 3),
        height_m=sizes["height_m"],
        base="legs" if base > 0.06 else "plinth" if base > 0.015 else "none",
        base_m=base if base > 0.015 else 0.0,
        worktop_m=WORKTOP_M,
        name="furniture",
    )


def _table(front: ObjectFront, sizes: Mapping[str, float]) -> FrontLayout:
    """Return a table: what the front leaves free at the floor is open."""
    layout = _storage(front, sizes)
    moving = [panel for panel in layout.panels if panel.kind in MOVING]
    panels = with_fixed(moving, "panel", "gap")
    return dataclasses.replace(layout, panels=panels, name="table", category="Table")


def _fridge(front: ObjectFront, sizes: Mapping[str, float]) -> FrontLayout:
    """Return a refrigerator: its parts are doors, wide low ones at the bottom drawers."""
    layout = _storage(front, sizes, FRIDGE_BOARD_M)
    return dataclasses.replace(
        layout,
        name="fridge",
        category="Refrigerator",
        base="plinth",
        base_m=0.04,
        worktop_m=0.0,
        board_m=FRIDGE_BOARD_M,
        handle_m=0.4,
    )


def _microwave(front: ObjectFront, sizes: Mapping[str, float]) -> FrontLayout:
    """Return a microwave: one door, beside a control panel on its free side."""
    edges = [part.right for part in front.parts if part.left < 0.2]
    split = float(np.clip(max(edges, default=0.76), 0.6, 0.9))
    return FrontLayout(
        panels=(
            FrontPanel(
                kind="door", left=0.0, right=split, bottom=0.0, top=1.0, hinge="left", name="door"
            ),
            FrontPanel(kind="panel", left=split, right=1.0, bottom=0.0, top=1.0),
        ),
        width_m=round(sizes["width_m"], 3),
        depth_m=round(sizes["depth_m"], 3),
        height_m=sizes["height_m"],
        base="plinth",
        base_m=0.012,
        worktop_m=0.0,
        board_m=0.02,
        name="microwave",
        category="Microwave",
    )


def _front_loader(
    front: ObjectFront, sizes: Mapping[str, float], name: str, category: str
) -> FrontLayout:
    """Return an appliance whose door falls open, below a band of controls."""
    top = float(np.clip(max((part.top for part in front.parts), default=0.87), *CONTROLS))
    least = 1.05 * least_front_m(OVEN_BOARD_M) / (sizes["height_m"] - PLINTH_M - COOKTOP_M)
    below = [part.top for part in front.parts if least < part.top < LOW_DRAWER]
    low = max(below) if below and category == "Oven" else 0.0
    panels = [
        FrontPanel(kind="panel", left=0.0, right=1.0, bottom=top, top=1.0),
        FrontPanel(
            kind="flap", left=0.0, right=1.0, bottom=low, top=top, hinge="bottom", name="door"
        ),
    ]
    if low > 0.0:
        panels.append(FrontPanel(kind="drawer", left=0.0, right=1.0, bottom=0.0, top=low))
    return FrontLayout(
        panels=tuple(panels),
        width_m=round(sizes["width_m"], 3),
        depth_m=round(sizes["depth_m"], 3),
        height_m=sizes["height_m"],
        base="plinth",
        base_m=PLINTH_M,
        worktop_m=COOKTOP_M,
        board_m=OVEN_BOARD_M,
        handle_m=0.45,
        name=name,
        category=category,
    )


def _oven(front: ObjectFront, sizes: Mapping[str, float]) -> FrontLayout:
    return _front_loader(front, sizes, "oven", "Oven")


def _dishwasher(front: ObjectFront, sizes: Mapping[str, float]) -> FrontLayout:
    return _front_loader(front, sizes, "dishwasher", "Dishwasher")


_LAYOUTS: Mapping[str, Callable[..., FrontLayout]] = {
    "StorageFurniture": _storage,
    "Table": _table,
    "Refrigerator": _fridge,
    "Microwave": _microwave,
    "Oven": _oven,
    "Dishwasher": _dishwasher,
}
