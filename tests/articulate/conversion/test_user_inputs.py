"""Objects as users write them: degrees, millimetres, two-way doors, y up."""

import math
import resource
from pathlib import Path

import numpy as np
import pytest
import trimesh

from articulate.conversion import convert
from articulate.errors import AssetError
from articulate.formats.config import ConvertConfig
from articulate.geometry.height_map import CELL_M, MAX_CELLS, height_map

INPUTS = Path(__file__).parent / "inputs"


def converted(name, tmp_path, **options):
    return convert(INPUTS / f"{name}.urdf", tmp_path / "out", ConvertConfig(**options))


@pytest.mark.parametrize(("name", "far"), [("zero_to_90", 90.0), ("minus90_to_zero", -90.0)])
def test_limits_in_degrees_are_read_with_their_sign(name, far, tmp_path):
    asset = converted(name, tmp_path)
    hinge = asset.joint("hinge")
    assert (hinge.closed, hinge.open) == (0.0, pytest.approx(math.radians(far)))
    assert {hinge.lower, hinge.upper} == {hinge.closed, hinge.open}
    assert any("are degrees" in message for message in asset.repairs)


def test_a_cabinet_in_centimetres_is_converted_and_listed(tmp_path):
    asset = converted("centimetres", tmp_path)
    assert np.ptp(asset.bounds_o, axis=0).max() == pytest.approx(0.5, abs=0.05)
    assert any("numbers are cm" in message for message in asset.repairs)


def test_a_cabinet_in_millimetres_is_rejected_with_the_flag_until_its_size_is_set(tmp_path):
    with pytest.raises(AssetError, match=r"0\.2 m in mm, 2 m in cm.*--size$"):
        converted("millimetres", tmp_path)
    asset = converted("millimetres", tmp_path, size_m=0.2)
    assert np.ptp(asset.bounds_o, axis=0).max() == pytest.approx(0.2)


def test_the_height_map_is_bounded_by_cells():
    wall = trimesh.creation.box((20.0, 20.0, 0.1))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    view = height_map(wall, np.ones(len(wall.faces), int), np.eye(3)[2], np.eye(3)[0])
    assert view.height.size <= 1.01 * MAX_CELLS
    assert view.cell_m > CELL_M
    assert view.is_part.any()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 400_000  # [kB]


def test_a_double_acting_door_is_closed_in_its_frame_and_opens_to_one_side(tmp_path):
    hinge = converted("two_way_door", tmp_path).joint("hinge")
    assert (hinge.closed, hinge.open, hinge.lower, hinge.upper) == (0.0, 1.57, 0.0, 1.57)
    assert "smaller there" in hinge.closed_rule
    assert "both sides are alike" in hinge.closed_rule


def test_an_object_with_y_up_is_turned_upright_on_request_and_noted_otherwise(tmp_path):
    asset = converted("y_up_cabinet", tmp_path, up="y")
    assert np.ptp(asset.bounds_o, axis=0) == pytest.approx([0.5, 0.475, 0.3], abs=0.01)
    assert abs(asset.joint("hinge").axis_o[2]) == pytest.approx(1.0)
    handle = asset.handle_of("hinge")
    assert handle is not None
    front = asset.T_ol("hinge", 0.0)[:3, :3] @ np.asarray(handle.normal_l)
    assert front == pytest.approx([0.0, -1.0, 0.0], abs=1e-6)
    assert not any("--up y" in message for message in asset.repairs)
    asset = converted("y_up_cabinet", tmp_path)
    assert any("door opens upwards" in message for message in asset.repairs)


def test_a_chest_whose_lid_opens_upwards_is_not_suspected(tmp_path):
    text = (INPUTS / "y_up_cabinet.urdf").read_text().replace('"door"', '"lid"')
    (tmp_path / "chest.urdf").write_text(text)
    asset = convert(tmp_path / "chest.urdf", tmp_path / "out")
    assert not any("--up y" in message for message in asset.repairs)
