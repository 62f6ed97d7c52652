import dataclasses

import numpy as np
import pytest
from tests.articulate.checks.objects import Part, make_object
from tests.assets import make_cabinet

from articulate.checks.model import load_model
from articulate.errors import AssetError


def test_links_lie_where_the_joints_put_them(tmp_path):
    model = load_model(make_cabinet(tmp_path))
    data = model.data()
    closed = model.T_ol(data, "drawer_1")
    model.set_joints(data, {"drawer_1_slide": 0.1})
    moved = model.T_ol(data, "drawer_1")
    np.testing.assert_allclose(moved[:3, 3] - closed[:3, 3], [-0.1, 0.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(model.T_ol(data, "carcass"), np.eye(4))


def test_joints_that_are_not_named_go_back_to_closed(tmp_path):
    model = load_model(make_cabinet(tmp_path))
    data = model.data()
    model.set_joints(data, {"drawer_0_slide": 0.2})
    model.set_joints(data, {"drawer_1_slide": 0.1})
    assert data.qpos[model.qpos_address("drawer_0_slide")] == 0.0
    assert data.qpos[model.qpos_address("drawer_1_slide")] == 0.1


def test_a_joint_that_follows_goes_where_its_leader_puts_it(tmp_path):
    box = (((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)),)
    lead = Part(name="lead", kind="slide", axis=(1.0, 0.0, 0.0), boxes=box)
    tail = Part(name="tail", kind="slide", axis=(1.0, 0.0, 0.0), boxes=box, follows="lead")
    model = load_model(make_object(tmp_path / "pair", lead, tail))
    assert model.free_joints == ("lead_joint",)
    data = model.data()
    model.set_joints(data, {"lead_joint": 0.07})
    assert data.qpos[model.qpos_address("tail_joint")] == pytest.approx(0.07)
    q = model.random_joints(np.random.default_rng(0))
    assert q["tail_joint"] == q["lead_joint"]


def test_geoms_that_can_touch_are_told_from_those_that_are_seen(tmp_path):
    boxes = (((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)), ((0.0, 0.0, 1.0), (0.1, 0.1, 0.1)))
    part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), boxes=boxes, shown=boxes[:1])
    model = load_model(make_object(tmp_path / "object", part))
    assert len(model.collision_geoms("part")) == 2
    assert len(model.visual_geoms("part")) == 1


def test_random_positions_keep_to_the_limits_and_endless_joints_turn_once(tmp_path):
    wheel = Part(name="wheel", kind="hinge", axis=(0.0, 0.0, 1.0), span=None)
    drawer = Part(name="drawer", kind="slide", axis=(1.0, 0.0, 0.0), span=0.2)
    model = load_model(make_object(tmp_path / "object", wheel, drawer))
    rng = np.random.default_rng(1)
    drawn = [model.random_joints(rng) for _ in range(200)]
    assert max(abs(q["wheel_joint"]) for q in drawn) <= np.pi
    assert min(q["drawer_joint"] for q in drawn) >= 0.0
    assert 0.19 < max(q["drawer_joint"] for q in drawn) <= 0.2


def test_what_the_model_lacks_is_named(tmp_path):
    asset = make_cabinet(tmp_path)
    text = asset.mjcf_path.read_text()
    asset.mjcf_path.write_text(text.replace('joint name="drawer_1_slide"', 'joint name="slide"'))
    with pytest.raises(AssetError, match=r"joint 'drawer_1_slide' of asset.json is absent"):
        load_model(asset)
    asset.mjcf_path.write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    with pytest.raises(AssetError, match="MuJoCo rejects it"):
        load_model(asset)
    asset.mjcf_path.unlink()
    with pytest.raises(AssetError, match="does not exist"):
        load_model(asset)


def test_what_the_model_has_beyond_the_asset_is_named(tmp_path):
    """No clause would move it: a drawer that nobody lists would be proven unseen."""
    asset = make_cabinet(tmp_path)
    fewer = dataclasses.replace(asset, joints=asset.joints[:-1])
    with pytest.raises(AssetError, match=r"joint 'drawer_2_slide' is not in asset.json"):
        load_model(fewer)
    text = asset.mjcf_path.read_text()
    ghost = '<body name="ghost"><joint name="spin"/><geom size="0.1" mass="1"/></body></worldbody>'
    asset.mjcf_path.write_text(text.replace("</worldbody>", ghost))
    with pytest.raises(AssetError, match=r"joint 'spin' is not in asset.json"):
        load_model(asset)
