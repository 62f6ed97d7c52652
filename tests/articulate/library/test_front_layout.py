"""Objects with a divided front: places of parts, joints, and rejected layouts."""

from __future__ import annotations

import numpy as np
import pytest

from articulate.errors import ConfigError
from articulate.library.procedural.front_layout import (
    FrontLayout,
    FrontPanel,
    grid,
    least_front_m,
)
from articulate.library.procedural.solids import Box
from articulate.library.procedural.urdf import Part


def layout(*panels: FrontPanel, **changes: object) -> FrontLayout:
    size: dict[str, object] = {"width_m": 1.0, "depth_m": 0.5, "height_m": 1.0, **changes}
    return FrontLayout(panels=panels, **size)  # type: ignore[arg-type]


def by_name(parts: list[Part]) -> dict[str, Part]:
    return {part.name: part for part in parts}


def test_grid_divides_the_front_evenly() -> None:
    panels = grid(3, 2, "drawer")
    assert len(panels) == 6
    assert sum((p.right - p.left) * (p.top - p.bottom) for p in panels) == pytest.approx(1.0)


def test_drawers_slide_towards_the_front_and_are_numbered_from_the_top_left() -> None:
    parts = by_name(layout(*grid(2, 2, "drawer")).parts())
    assert set(parts) == {"body", *(f"drawer_{k}" for k in range(4))}
    origins = {name: np.array(p.motion.origin_p) for name, p in parts.items() if p.motion}
    assert origins["drawer_0"][1] > origins["drawer_1"][1]  # +y is left
    assert origins["drawer_0"][2] > origins["drawer_2"][2]
    assert all(p.motion.axis == (-1.0, 0.0, 0.0) for p in parts.values() if p.motion)


@pytest.mark.parametrize(
    ("kind", "hinge", "free_edge"),
    [
        ("door", "left", (0.0, -1.0, 0.0)),
        ("door", "right", (0.0, 1.0, 0.0)),
        ("flap", "top", (0.0, 0.0, -1.0)),
        ("flap", "bottom", (0.0, 0.0, 1.0)),
    ],
)
def test_free_edge_swings_towards_the_front(
    kind: str, hinge: str, free_edge: tuple[float, float, float]
) -> None:
    panel = FrontPanel(kind=kind, left=0, right=1, bottom=0, top=1, hinge=hinge)  # type: ignore[arg-type]
    (_, part) = layout(panel).parts()
    assert part.motion is not None
    velocity = np.cross(part.motion.axis, free_edge)
    assert velocity == pytest.approx([-1.0, 0.0, 0.0])


@pytest.mark.parametrize("handle", ["bar", "knob", "none"])
@pytest.mark.parametrize("width_m", [0.4, 1.0])
def test_a_sliding_door_passes_its_neighbour_and_stops_before_the_handle(
    handle: str, width_m: float
) -> None:
    sides = (("right", 0), ("left", 1))
    panels = [
        FrontPanel(
            kind="door",
            left=k / 2,
            right=(k + 1) / 2,
            bottom=0,
            top=1,
            slide=slide,  # type: ignore[arg-type]
            layer=layer,
            handle=handle,  # type: ignore[arg-type]
        )
        for k, (slide, layer) in enumerate(sides)
    ]
    doors = layout(*panels, width_m=width_m).parts()[1:]
    for moved, other in (doors, doors[::-1]):
        assert moved.motion is not None
        assert other.motion is not None
        assert moved.motion.upper > 0.25 * width_m
        travel = moved.motion.upper * np.array(moved.motion.axis)
        for a in corners_of(moved, travel):
            for b in corners_of(other, np.zeros(3)):
                apart = np.maximum(a[0] - b[1], b[0] - a[1])
                assert apart.max() > 0.001


def corners_of(part: Part, shift: np.ndarray) -> list[np.ndarray]:
    """Return the lowest and highest corner of each solid of a part (2, 3)."""
    assert part.motion is not None
    at = np.array(part.motion.origin_p) + shift
    meshes = [solid.mesh()[0] for one in part.shapes for solid in one.solids]
    return [np.array([mesh.min(axis=0), mesh.max(axis=0)]) + at for mesh in meshes]


@pytest.mark.parametrize("hinge", ["left", "right"])
@pytest.mark.parametrize(("width_m", "board_m"), [(1.0, 0.018), (0.63, 0.05), (0.4, 0.06)])
def test_a_thick_door_clears_the_closed_door_beside_it(
    hinge: str, width_m: float, board_m: float
) -> None:
    """The rear corner of its free edge is farther from the hinge than the front corner."""
    other = "right" if hinge == "left" else "left"
    sides = {hinge: 0.0 if hinge == "left" else 0.5, other: 0.5 if hinge == "left" else 0.0}
    panels = [
        FrontPanel(kind="door", left=at, right=at + 0.5, bottom=0, top=1, hinge=side, handle="none")  # type: ignore[arg-type]
        for side, at in sides.items()
    ]
    spans = []
    for part in layout(*panels, width_m=width_m, board_m=board_m).parts()[1:]:
        assert part.motion is not None
        y = part.shapes[0].solids[0].mesh()[0][:, 1] + part.motion.origin_p[1]
        spans.append((part.motion.origin_p[1], y.min(), y.max()))
    for (pivot, low, high), (_, next_low, next_high) in (spans, spans[::-1]):
        width = high - low
        room = next_low - pivot if next_low > pivot else pivot - next_high
        assert np.hypot(width, board_m) < room
        assert width > 0.45 * width_m


@pytest.mark.parametrize(("hinge", "end"), [("top", "max"), ("bottom", "min")])
def test_a_thick_flap_is_lower_at_its_free_edge_only(hinge: str, end: str) -> None:
    heights = {}
    for board_m in (0.018, 0.06):
        panel = FrontPanel(kind="flap", left=0, right=1, bottom=0, top=1, hinge=hinge)  # type: ignore[arg-type]
        (_, part) = layout(panel, height_m=0.35, board_m=board_m).parts()
        assert part.motion is not None
        z = part.shapes[0].solids[0].mesh()[0][:, 2]
        heights[board_m] = np.ptp(z)
        assert getattr(z, end)() == pytest.approx(0.0)
    assert heights[0.06] < heights[0.018]


@pytest.mark.parametrize("size_m", [0.4, 1.0, 1.5])
def test_a_flap_is_light_enough_to_be_lifted_at_its_edge(size_m: float) -> None:
    panel = FrontPanel(kind="flap", left=0, right=1, bottom=0, top=1, hinge="bottom")
    (_, part) = layout(panel, width_m=size_m, height_m=size_m, board_m=0.03).parts()
    (solid,) = part.shapes[0].solids
    assert isinstance(solid, Box)
    mass_kg = solid.density_kg_m3 * np.prod(solid.size)
    assert 0.5 * mass_kg * 9.81 < 15.0  # at the edge, half of the 30 N of the checks
    assert solid.density_kg_m3 <= 400.0


@pytest.mark.parametrize("kind", ["panel", "open"])
@pytest.mark.parametrize("share", [0.01, 0.0225, 0.03, 0.2])
def test_solids_of_narrow_strips_have_a_size(kind: str, share: float) -> None:
    strip = FrontPanel(kind=kind, left=0, right=1, bottom=1 - share, top=1)  # type: ignore[arg-type]
    door = FrontPanel(kind="door", left=0, right=1, bottom=0, top=1 - share, hinge="left")
    for part in layout(strip, door).parts():
        for own in part.shapes:
            assert all(np.ptp(solid.mesh()[0], axis=0).min() > 0 for solid in own.solids)
            assert all(min(solid.size) > 0 for solid in own.solids if isinstance(solid, Box))


@pytest.mark.parametrize("board_m", [0.018, 0.03, 0.05])
def test_the_smallest_drawer_has_a_tray(board_m: float) -> None:
    height_m = least_front_m(board_m) + 0.018
    panel = FrontPanel(kind="drawer", left=0, right=1, bottom=0, top=1)
    (_, part) = layout(panel, height_m=height_m, base="none", board_m=board_m).parts()
    sizes = [solid.size for own in part.shapes for solid in own.solids if isinstance(solid, Box)]
    assert min(min(size) for size in sizes) > 0.005
    with pytest.raises(ConfigError, match=r"too small|no room"):
        layout(panel, height_m=height_m - 0.001, base="none", board_m=board_m)


def test_overlapping_and_tiny_panels_are_rejected() -> None:
    with pytest.raises(ConfigError, match="overlap"):
        layout(*grid(1, 1, "drawer"), *grid(2, 1, "drawer"))
    with pytest.raises(ConfigError, match="too small"):
        layout(*grid(20, 1, "drawer"))
    with pytest.raises(ConfigError, match="hinge"):
        FrontPanel(kind="drawer", left=0, right=1, bottom=0, top=1, hinge="left")
    with pytest.raises(ConfigError, match="left and right"):
        FrontPanel(kind="drawer", left=0.5, right=0.5, bottom=0, top=1)


@pytest.mark.parametrize(("kind", "slide"), [("drawer", "left"), ("flap", "right"), ("door", "")])
def test_only_sliding_doors_have_a_layer(kind: str, slide: str) -> None:
    with pytest.raises(ConfigError, match="only a sliding door has a layer"):
        FrontPanel(kind=kind, left=0, right=1, bottom=0, top=1, slide=slide, layer=1)  # type: ignore[arg-type]
