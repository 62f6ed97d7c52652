import dataclasses
import json
import os

import numpy as np
import pytest
from numpy.testing import assert_allclose

from articulate.assets.asset import (
    Asset,
    Handle,
    Joint,
    Link,
    handle_frame,
    joint_motion,
    load_asset,
    save_asset,
)
from articulate.errors import AssetError


def box(folder):
    """A body with a drawer that slides along -x and a door that turns about z at x = y = 0.3."""
    identity = (1.0, 0.0, 0.0, 0.0)
    cube = ((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1))
    links = (
        Link(
            name="body", parent=None, pos_o=(0, 0, 0), quat_o=identity, mass_kg=5.0, bounds_l=cube
        ),
        Link(
            name="drawer",
            parent="body",
            pos_o=(0, 0, 0.5),
            quat_o=identity,
            mass_kg=1.0,
            bounds_l=cube,
        ),
        Link(
            name="door",
            parent="body",
            pos_o=(0.3, 0.3, 0),
            quat_o=identity,
            mass_kg=1.0,
            bounds_l=cube,
        ),
    )
    joints = (
        Joint(
            name="slide", kind="slide", link="drawer", parent="body", axis_o=(-1.0, 0.0, 0.0),
            pivot_o=(0, 0, 0.5), lower=0.0, upper=0.4, closed=0.0, open=0.4, closed_rule="limit",
        ),
        Joint(
            name="hinge", kind="hinge", link="door", parent="body", axis_o=(0.0, 0.0, 1.0),
            pivot_o=(0.3, 0.3, 0), lower=None, upper=None, closed=0.0, open=np.pi / 2,
            closed_rule="rest",
        ),
    )  # fmt: skip
    handle = Handle(
        name="pull", link="drawer", joint="slide", pos_l=(-0.3, 0.0, 0.0),
        normal_l=(-1.0, 0.0, 0.0), along_l=(0.0, 1.0, 0.0), extent=(0.1, 0.01, 0.03),
        kind="bar", source="name",
    )  # fmt: skip
    return Asset(
        name="box", category="StorageFurniture", links=links, joints=joints, handles=(handle,),
        bounds_o=cube, repairs=("nothing",), folder=folder,
    )  # fmt: skip


def test_asset_comes_back_from_its_folder(tmp_path):
    asset = box(tmp_path)
    save_asset(asset)
    assert load_asset(tmp_path) == asset


def test_asset_file_says_its_schema_and_not_its_folder(tmp_path):
    content = json.loads(save_asset(box(tmp_path)).read_text())
    assert content["schema"] == "articulate.asset"
    assert "folder" not in content


def test_slide_moves_its_link_along_the_axis(tmp_path):
    T_ol = box(tmp_path).T_ol("slide", np.array([0.0, 0.4]))
    assert_allclose(T_ol[:, :3, 3], [[0, 0, 0.5], [-0.4, 0, 0.5]], atol=1e-15)
    assert_allclose(T_ol[:, :3, :3], np.broadcast_to(np.eye(3), (2, 3, 3)))


def test_hinge_turns_its_link_about_the_pivot(tmp_path):
    asset = box(tmp_path)
    T_ol = asset.T_ol("hinge", np.pi / 2)
    assert_allclose(T_ol[:3, 3], [0.3, 0.3, 0.0], atol=1e-15)
    assert_allclose(T_ol[:3, 0], [0.0, 1.0, 0.0], atol=1e-15)
    moved = joint_motion(asset.joint("hinge"), np.pi / 2) @ [0.5, 0.3, 0.0, 1.0]
    assert_allclose(moved, [0.3, 0.5, 0.0, 1.0], atol=1e-15)


def test_hand_frame_of_a_handle_approaches_against_its_normal(tmp_path):
    asset = box(tmp_path)
    frame = handle_frame(asset.handles[0])
    assert np.linalg.det(frame[:3, :3]) == pytest.approx(1.0)
    assert_allclose(frame[:3, 2], [1.0, 0.0, 0.0])
    assert_allclose(frame[:3, 0], [0.0, 1.0, 0.0])
    assert_allclose(asset.T_oh("slide", 0.1)[:3, 3], [-0.4, 0.0, 0.5], atol=1e-15)


def test_the_way_of_a_handle_is_that_of_its_joint_or_an_arc(tmp_path):
    asset = box(tmp_path)
    assert asset.handle_travel("slide") == pytest.approx(0.4)
    assert asset.handle_travel("hinge") is None
    on_door = dataclasses.replace(
        asset.handles[0], link="door", joint="hinge", pos_l=(0.3, -0.4, 7.0)
    )
    asset = dataclasses.replace(asset, handles=(on_door,))
    assert asset.handle_travel("hinge") == pytest.approx(0.5 * np.pi / 2)  # 0.5 m from its axis


def test_span_has_the_sign_of_opening(tmp_path):
    slide = dataclasses.replace(box(tmp_path).joint("slide"), closed=0.4, open=0.0)
    assert slide.span == -0.4


def test_names_that_do_not_exist_are_answered_with_those_that_do(tmp_path, error_line):
    asset = box(tmp_path)
    error_line("asset.joint('sldie')", lambda: asset.joint("sldie"))
    error_line("asset.link('lid')", lambda: asset.link("lid"))
    error_line("asset.T_oh('hinge', 0.0)", lambda: asset.T_oh("hinge", 0.0))


def test_folder_without_an_asset_is_refused(tmp_path):
    with pytest.raises(AssetError, match="not an asset folder"):
        load_asset(tmp_path)


def test_asset_of_another_schema_is_refused(tmp_path, error_line):
    path = save_asset(box(tmp_path))
    path.write_text(path.read_text().replace('"schema_version": 2', '"schema_version": 99'))
    error_line("load_asset(folder)  # schema_version 99", lambda: load_asset(tmp_path))


def test_asset_with_a_missing_field_is_refused(tmp_path, error_line):
    path = save_asset(box(tmp_path))
    path.write_text(path.read_text().replace('"closed_rule"', '"closed_rul"'))
    error_line("load_asset(folder)  # closed_rul", lambda: load_asset(tmp_path))


def test_content_id_changes_with_content_and_with_names(tmp_path):
    asset = box(tmp_path)
    save_asset(asset)
    first = asset.content_id()
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.obj").write_text("v 0 0 0")
    second = asset.content_id()
    (tmp_path / "meshes" / "a.obj").rename(tmp_path / "meshes" / "b.obj")
    assert len({first, second, asset.content_id()}) == 3


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        '"a"',
        "[" * 100_000,
        '{"a": ' * 100_000,
        "\xff",
        '{"schema": NaN}',
        '{"schema": 1e999}',
        '{"schema": "articulate.asset", "schema": "articulate.asset"}',
    ],
)
def test_hostile_asset_files_are_rejected_in_one_short_line(tmp_path, text):
    (tmp_path / "asset.json").write_text(text, encoding="latin-1")
    with pytest.raises(AssetError) as caught:
        load_asset(tmp_path)
    line = str(caught.value).replace(str(tmp_path), "")
    assert "\n" not in line
    assert len(line) < 300


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("name", 5),
        ("joints", {"a": 1}),
        ("joints", [5]),
        ("joints", 5),
        ("links", [{}]),
        ("bounds_o", [[0, 0], [1, 1]]),
        ("repairs", [1]),
        ("category", "x" * 60_000),
    ],
)
def test_values_of_another_type_are_rejected(tmp_path, field, value):
    path = save_asset(box(tmp_path))
    content = json.loads(path.read_text()) | {field: value}
    path.write_text(json.dumps(content))
    with pytest.raises(AssetError) as caught:
        load_asset(tmp_path)
    assert len(str(caught.value).replace(str(tmp_path), "")) < 300


def test_a_fifo_or_a_link_to_a_device_is_rejected(tmp_path):
    os.mkfifo(tmp_path / "asset.json")
    with pytest.raises(AssetError, match="not a regular file"):
        load_asset(tmp_path)
    (tmp_path / "asset.json").unlink()
    (tmp_path / "asset.json").symlink_to("/dev/zero")
    with pytest.raises(AssetError, match="not a regular file"):
        load_asset(tmp_path)
