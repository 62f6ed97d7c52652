import numpy as np
import pytest
import trimesh
from tests.articulate.conversion.cabinets import write_cabinet

from articulate.assets.asset import load_asset
from articulate.checks.model import load_model
from articulate.checks.source import origin_of_reading
from articulate.checks.visual_fidelity import check_visual_fidelity, least_shares, shares
from articulate.conversion import ConvertConfig, convert
from articulate.conversion.convert import read_input

CONFIG = ConvertConfig(decompose=False, size_m=0.4)


@pytest.fixture
def made(tmp_path):
    source = write_cabinet(tmp_path)
    asset = convert(source, tmp_path / "asset", CONFIG)
    return asset, origin_of_reading(read_input(source, CONFIG), CONFIG)


def test_a_fresh_asset_shows_what_its_input_shows(made):
    asset, origin = made
    checks = check_visual_fidelity(load_model(asset), origin)
    assert [(c.subject, c.outcome, c.measured) for c in checks] == [
        ("body", "passed", 1.0),
        ("drawer", "passed", 1.0),
        ("door", "passed", 1.0),
    ]


@pytest.mark.parametrize("scale", ["1 -1 1", "1.05 1 1"])
def test_a_mirrored_or_stretched_mesh_is_found(made, scale):
    asset, origin = made
    text = asset.mjcf_path.read_text()
    (file,) = {word for word in text.split() if word.startswith('file="v02_000')}
    asset.mjcf_path.write_text(text.replace(file, f'{file[:-2]} scale="{scale}"/>'))
    checks = check_visual_fidelity(load_model(load_asset(asset.folder)), origin)
    assert [c.subject for c in checks if c.outcome == "failed"] == ["door"]


def test_a_lost_visual_is_found(made):
    asset, origin = made
    lines = asset.mjcf_path.read_text().splitlines(keepends=True)
    kept = [line for line in lines if not ("<geom" in line and 'mesh="v01_000"' in line)]
    assert len(kept) == len(lines) - 1
    asset.mjcf_path.write_text("".join(kept))
    failed = [c for c in check_visual_fidelity(load_model(asset), origin) if c.outcome == "failed"]
    assert [c.subject for c in failed] == ["drawer"]


def test_a_link_that_is_absent_is_found(made):
    asset, origin = made
    extra = {**origin.visuals, "shelf": origin.visuals["door"]}
    from_elsewhere = type(origin)(
        source=origin.source, frame=origin.frame, root=origin.root, visuals=extra
    )
    failed = [
        c for c in check_visual_fidelity(load_model(asset), from_elsewhere) if c.outcome == "failed"
    ]
    assert [c.subject for c in failed] == ["shelf"]


def test_shares_of_two_boxes_are_those_of_their_common_faces():
    one = np.asarray(trimesh.creation.box((1.0, 1.0, 1.0)).triangles)
    other = one.copy()
    other[other[:, :, 2] > 0.0] += [0.0, 0.0, 1.0]  # twice as high
    kept, new = shares([one], [other])
    assert kept == pytest.approx(5.0 / 6.0, abs=0.02)
    assert new == pytest.approx(5.0 / 10.0, abs=0.03)


def panels(count):
    """Boxes of 10 x 10 x 1 cm in a row, and the last of them far smaller than the others."""
    boxes = [trimesh.creation.box((0.1, 0.1, 0.01)) for _ in range(count - 1)]
    boxes.append(trimesh.creation.box((0.02, 0.01, 0.01)))
    for k, box in enumerate(boxes):
        box.apply_translation((0.2 * k, 0.0, 0.0))
    return [np.asarray(box.triangles) for box in boxes]


def test_a_small_mesh_among_many_counts_by_itself():
    given = panels(30)
    moved = [*given[:-1], given[-1] + [0.0, 0.0, 0.05]]
    assert min(shares(given, moved)) > 0.99  # it is a thousandth of the surface
    assert least_shares(given, moved) == (0.0, 0.0)
    assert least_shares(given, given) == (1.0, 1.0)


def test_a_small_mesh_that_is_lost_counts_by_itself():
    given = panels(30)
    kept, new = least_shares(given, given[:-1])
    assert kept == 0.0
    assert new == 1.0


def test_what_one_mesh_shows_may_be_shown_by_another():
    given = panels(3)
    twice = [*given, given[0]]
    assert least_shares(given, twice) == (1.0, 1.0)


def test_meshes_without_area_are_no_loss():
    given = panels(3)
    flat = np.zeros((1, 3, 3))
    assert least_shares([*given, flat], given) == (1.0, 1.0)
