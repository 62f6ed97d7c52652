"""The physics of passed objects is compared with that of boxes, for the first ten by id."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.articulate.checks.objects import Part, make_object

import assets
from articulate.simulator import mujoco

TRAY = tuple(
    ((x, y, 0.0), (0.1 if y else 0.01, 0.01 if y else 0.1, 0.05))
    for x, y in ((0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1))
)


def test_the_first_of_a_category_by_number_are_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assets, "step_ratio", lambda folder: float(len(folder.name)))
    rows = [
        {"id": f"partnet_{k}", "category": category, "source": "partnet", "verdict": verdict}
        for k, category, verdict in (
            (300, "StorageFurniture", "passed"),
            (45, "StorageFurniture", "repaired"),
            (7, "StorageFurniture", "rejected"),
            (8, "Table", "passed"),
            *((k, "StorageFurniture", "passed") for k in range(1000, 1020)),
        )
    ]
    found = assets.physics_cost(Path("out"), rows)
    assert list(found) == [
        "partnet_45",
        "partnet_300",
        *(f"partnet_{k}" for k in range(1000, 1008)),
    ]
    assert found["partnet_45"] == 10.0


def test_each_connected_component_becomes_one_box(tmp_path: Path) -> None:
    drawer = Part(name="drawer", kind="slide", axis=(-1.0, 0.0, 0.0), boxes=TRAY)
    made = make_object(tmp_path / "a", drawer)
    model = assets.boxes_only(made.folder)
    touching = [g for g in range(model.ngeom) if model.geom_contype[g]]
    assert len(touching) == len(TRAY) + 1
    assert {int(model.geom_type[g]) for g in touching} == {int(mujoco.mjtGeom.mjGEOM_BOX)}


def test_an_object_of_boxes_costs_what_boxes_cost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assets, "STEPS", 50)
    drawer = Part(name="drawer", kind="slide", axis=(-1.0, 0.0, 0.0), boxes=TRAY)
    assert 0.1 < assets.step_ratio(make_object(tmp_path / "a", drawer).folder) < 10.0


@pytest.mark.parametrize(
    ("reason", "check"),
    [
        ("cavities of link_1: 79.2% of the cavity is free", "cavities"),
        ("authored_overlap of door: it goes 9 mm deeper into the wall", "authored_overlap"),
        ("/tmp/kettle.xml: a scene with 8 free bodies, not one object", "unreadable"),
    ],
)
def test_reasons_are_counted_by_check(reason: str, check: str) -> None:
    assert assets.check_of(reason) == check
