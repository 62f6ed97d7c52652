import pytest
from tests.articulate.checks.objects import Part, make_object

from articulate.checks.coverage import check_coverage
from articulate.checks.model import load_model

SEEN = (((0.0, 0.0, 0.0), (0.2, 0.2, 0.01)), ((0.0, 0.0, 0.2), (0.01, 0.2, 0.2)))


def covered(folder, boxes, shown=SEEN):
    part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), boxes=boxes, shown=shown)
    checks = check_coverage(load_model(make_object(folder / "object", part)))
    return {c.subject: c for c in checks}["part"]


def test_shapes_that_are_what_is_seen_cover_it(tmp_path):
    check = covered(tmp_path, SEEN)
    assert check.outcome == "passed"
    assert check.measured == 1.0


def test_a_link_without_collision_shapes_fails(tmp_path):
    check = covered(tmp_path, ())
    assert check.outcome == "failed"
    assert check.measured == 0.0
    assert "have no collision shape" in check.message


@pytest.mark.parametrize("kind", ["ellipsoid", "plane"])
def test_shapes_beside_boxes_count_or_fail(tmp_path, kind):
    asset = make_object(tmp_path / "object", body=SEEN)
    text = asset.mjcf_path.read_text()
    geom = f'<geom type="{kind}" size="0.3 0.3 0.3" pos="0 0 2"/>'
    asset.mjcf_path.write_text(text.replace('<body name="body">', f'<body name="body">{geom}'))
    check = check_coverage(load_model(asset))[0]
    assert check.outcome == "failed"
    said = "fill empty space" if kind == "ellipsoid" else "of type plane, which cannot be measured"
    assert said in check.message


def test_a_part_that_cannot_be_touched_is_measured_by_its_area(tmp_path):
    plate, wall = (2 * (0.4 * 0.4 + 2 * 0.4 * 0.02)), (2 * (0.4 * 0.4 + 0.02 * 0.4 * 2))
    check = covered(tmp_path, SEEN[:1])
    assert check.outcome == "failed"
    # The foot of the wall lies in the plate or near it.
    assert check.measured == pytest.approx(plate / (plate + wall), abs=0.05)


def test_a_shape_that_stands_for_nothing_fails(tmp_path):
    check = covered(tmp_path, (((0.0, 0.0, 0.1), (0.2, 0.2, 0.3)),))
    assert check.outcome == "failed"
    assert "fill empty space" in check.message


def test_shapes_may_be_one_hundredth_of_the_diagonal_off(tmp_path):
    near = tuple((pos, tuple(h + 0.003 for h in half)) for pos, half in SEEN)
    far = tuple((pos, tuple(h + 0.012 for h in half)) for pos, half in SEEN)
    assert covered(tmp_path / "near", near).outcome == "passed"  # the diagonal is 0.71 m
    assert covered(tmp_path / "far", far).outcome == "failed"
