import pytest
from tests.assets import make_cabinet, make_cupboard

from articulate.checks.limits import check_limits
from articulate.checks.model import load_model

URDF = """<robot name="cupboard"><link name="carcass"/><link name="door"/>
<joint name="door_hinge" type="{kind}"><parent link="carcass"/><child link="door"/>
<limit lower="0" upper="{upper}" effort="1" velocity="1"/></joint></robot>"""


def test_ranges_that_say_the_same_pass(tmp_path):
    asset = make_cupboard(tmp_path, degrees=90.0)
    (tmp_path / "object.urdf").write_text(URDF.format(kind="revolute", upper=1.5707963267949))
    (check,) = check_limits(load_model(asset))
    assert check.outcome == "passed"
    assert check.measured == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "upper", "said"),
    [
        ("revolute", 1.5, "object.urdf has from 0 to 1.5"),
        ("continuous", 1.5, "object.urdf has without end"),
        ("prismatic", 1.5707963267949, "object.urdf has prismatic"),
    ],
)
def test_an_urdf_that_says_something_else_fails(tmp_path, kind, upper, said):
    asset = make_cupboard(tmp_path, degrees=90.0)
    (tmp_path / "object.urdf").write_text(URDF.format(kind=kind, upper=upper))
    (check,) = check_limits(load_model(asset))
    assert check.outcome == "failed"
    assert said in check.message


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('range="0.0 0.28"', 'range="0.0 0.2"', "its open position 0.28 is outside"),
        ('range="0.0 0.28"', "", "a slide without end"),
        ('type="slide"', 'type="hinge"', "asset.json calls it a slide, the MJCF a hinge"),
    ],
)
def test_a_range_that_was_changed_in_the_mjcf_fails(tmp_path, old, new, said):
    asset = make_cabinet(tmp_path, drawers=1)
    text = asset.mjcf_path.read_text()
    assert old in text
    asset.mjcf_path.write_text(text.replace(old, new))
    (check,) = check_limits(load_model(asset))
    assert check.outcome == "failed"
    assert check.subject == "drawer_0_slide"
    assert said in check.message


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('damping="5.0"', 'damping="50"', "its damping is 50 N s/m, in asset.json 5"),
        (
            'frictionloss="2.0"',
            'frictionloss="1.9"',
            "its dry friction is 1.9 N, in asset.json 2",
        ),
    ],
)
def test_a_resistance_that_was_changed_in_the_mjcf_fails(tmp_path, old, new, said):
    asset = make_cabinet(tmp_path, drawers=1)
    text = asset.mjcf_path.read_text()
    assert old in text
    asset.mjcf_path.write_text(text.replace(old, new))
    (check,) = check_limits(load_model(asset))
    assert (check.outcome, check.subject) == ("failed", "drawer_0_slide")
    assert said in check.message


@pytest.mark.parametrize(
    ("dynamics", "outcome"),
    [
        ('<dynamics damping="0.1" friction="0.1"/>', "passed"),
        ('<dynamics damping="0.1"/>', "passed"),
        ('<dynamics damping="0.1" friction="0.2"/>', "failed"),
        ('<dynamics damping="9" friction="0.1"/>', "failed"),
        ('<dynamics friction="much"/>', "failed"),
    ],
)
def test_resistance_in_the_urdf_counts_where_it_says_any(tmp_path, dynamics, outcome):
    asset = make_cupboard(tmp_path, degrees=90.0)
    text = URDF.format(kind="revolute", upper=1.5707963267949)
    (tmp_path / "object.urdf").write_text(text.replace("<limit", f"{dynamics}<limit"))
    (check,) = check_limits(load_model(asset))
    assert check.outcome == outcome
