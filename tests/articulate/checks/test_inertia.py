import dataclasses

import pytest
from tests.articulate.checks.objects import Part, make_object

from articulate.checks.inertia import check_inertia
from articulate.checks.model import load_model

HALF = (0.1, 0.2, 0.3)
BOX = (((0.0, 0.0, 0.0), HALF),)


def measured(folder, mass=3.0, com=(0.0, 0.0, 0.0), moments=None):
    """Clauses about a solid box with these numbers for its inertial, by subject."""
    squares = [4.0 * h * h for h in HALF]
    if moments is None:
        moments = [mass * (sum(squares) - s) / 12.0 for s in squares]
    part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), boxes=BOX, mass_kg=mass, com=com)
    asset = make_object(folder / "object", part)
    text = asset.mjcf_path.read_text()
    numbers = " ".join(map(repr, moments))
    old = f'diaginertia="{part.inertia} {part.inertia} {part.inertia}"'
    assert old in text
    asset.mjcf_path.write_text(text.replace(old, f'diaginertia="{numbers}"'))
    links = tuple(dataclasses.replace(x, mass_kg=mass) for x in asset.links if x.name == "part")
    asset = dataclasses.replace(asset, links=(asset.links[0], *links))
    return {c.subject: c for c in check_inertia(load_model(asset))}


def test_a_box_with_its_own_inertia_passes(tmp_path):
    check = measured(tmp_path)["part"]
    assert check.outcome == "passed"
    a, b, c = (4.0 * h * h for h in HALF)
    assert check.measured == pytest.approx(((a + b) + (a + c) - (b + c)) / (b + c))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"com": (0.0, 0.0, 0.35)}, "centre of mass is 50 mm outside its box"),
        ({"moments": [2.0, 2.0, 2.0]}, "times the most that fits into its box"),
    ],
)
def test_what_no_such_box_can_have_fails(tmp_path, wrong, said):
    check = measured(tmp_path, **wrong)["part"]
    assert check.outcome == "failed"
    assert said in check.message


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('mass value="3"', 'mass value="3.1"', "object.urdf has 3.1 kg"),
        ('xyz="0 0 0"', 'xyz="0 0 0.01"', "has its centre of mass elsewhere"),
        ('iyy="0.13"', 'iyy="0.12"', "gives it another inertia"),
        ("", "", None),
    ],
)
def test_an_inertial_that_differs_from_the_urdf_fails(tmp_path, old, new, said):
    """The moments of the box are 0.13, 0.10 and 0.05; the URDF has them turned about z."""
    urdf = """<robot name="object"><link name="body"/><link name="part"><inertial>
<origin xyz="0 0 0" rpy="0 0 1.5707963267948966"/><mass value="3"/>
<inertia ixx="0.10" ixy="0" ixz="0" iyy="0.13" iyz="0" izz="0.05"/></inertial></link>
<joint name="part_joint" type="prismatic"><parent link="body"/><child link="part"/>
<limit lower="0" upper="0.3" effort="1" velocity="1"/></joint></robot>"""
    (tmp_path / "object").mkdir()
    (tmp_path / "object" / "object.urdf").write_text(urdf.replace(old, new) if old else urdf)
    check = measured(tmp_path)["part"]
    assert check.outcome == ("passed" if said is None else "failed"), check.message
    assert said is None or said in check.message


def test_a_mass_that_asset_json_does_not_know_fails(tmp_path):
    part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), boxes=BOX, mass_kg=2.0)
    asset = make_object(tmp_path / "object", part)
    text = asset.mjcf_path.read_text()
    asset.mjcf_path.write_text(text.replace('mass="2.0"', 'mass="9.0"'))
    checks = {c.subject: c for c in check_inertia(load_model(asset))}
    assert "asset.json has 2 kg" in checks["part"].message
    assert checks["part"].outcome == "failed"


def test_a_triangle_inequality_that_does_not_hold_fails(tmp_path):
    """MuJoCo rejects it when it compiles; a model may be changed afterwards."""
    part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), boxes=BOX)
    model = load_model(make_object(tmp_path / "object", part))
    model.model.body_inertia[model.bodies["part"]] = [0.1, 0.02, 0.03]
    checks = {c.subject: c for c in check_inertia(model)}
    assert "greater than the sum of the others" in checks["part"].message
    model.model.body_inertia[model.bodies["part"]] = [0.1, -0.02, 0.03]
    checks = {c.subject: c for c in check_inertia(model)}
    assert "not positive definite" in checks["part"].message
    model.model.body_mass[model.bodies["part"]] = 0.0
    checks = {c.subject: c for c in check_inertia(model)}
    assert "mass is not above 0" in checks["part"].message


def test_the_total_mass_is_said_and_never_refused(tmp_path):
    check = measured(tmp_path, mass=3.0)[""]
    assert check.name == "mass"
    assert check.outcome == "passed"
    assert check.measured > 3.0
