"""What the 3-D view is told against closed forms, and what a browser makes of it."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from tests.articulate.asset_page.browser import Browser
from tests.articulate.checks.objects import Part, make_object
from tests.assets import make_cabinet, make_cupboard

from articulate.asset_page.page import ReportPage
from articulate.asset_page.viewer import slider_range, viewer_content, viewer_html
from articulate.asset_page.views import front_azimuth_deg
from articulate.checks.model import load_model
from articulate.checks.triangles import surfaces_of, triangles_of
from articulate.simulator import mujoco

BALL = """<mujoco><asset><mesh name="ball" builtin="sphere" params="4"/></asset>
<worldbody><body name="body"><geom type="mesh" mesh="ball" contype="0" conaffinity="0"/></body>
</worldbody></mujoco>"""
BENT = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))
"""Corners of an L of area 3, whose hull has area 3.5."""
BOX = (((0.2, 0.0, 0.3), (0.1, 0.05, 0.02)),)


def decoded(surface):
    """Corners (V, 3) and triangles (F, 3) of a surface as the page has it."""
    grid = np.frombuffer(base64.b64decode(surface["vertices"]), "<u2").reshape(-1, 3)
    faces = np.frombuffer(base64.b64decode(surface["faces"]), "<u4" if surface["wide"] else "<u2")
    return np.array(surface["low"]) + grid * np.array(surface["step"]), faces.reshape(-1, 3)


def area_and_volume(vertices, faces):
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return mesh.area, mesh.volume


def test_a_box_is_sent_where_it_stands_and_as_large_as_it_is(tmp_path):
    part = Part(name="lid", kind="hinge", axis=(0, 1, 0), pos=(0.0, 0.0, 0.4), boxes=BOX)
    content = viewer_content(load_model(make_object(tmp_path / "a", part)))
    sent = [s for s in content["surfaces"] if s["link"] == "lid" and s["layer"] == "visual"]
    assert len(sent) == 1
    vertices, faces = decoded(sent[0])
    assert len(faces) == 12
    assert np.ptp(vertices, axis=0) == pytest.approx([0.2, 0.1, 0.04])
    assert vertices.mean(axis=0) == pytest.approx([0.2, 0.0, 0.7])
    area, volume = area_and_volume(vertices, faces)
    assert volume == pytest.approx(0.2 * 0.1 * 0.04)
    assert area == pytest.approx(2 * (0.2 * 0.1 + 0.2 * 0.04 + 0.1 * 0.04))


def test_positions_are_kept_within_half_a_step_of_their_box(tmp_path):
    asset = make_object(tmp_path / "a")
    asset.mjcf_path.write_text(BALL, encoding="utf-8")
    model = load_model(asset)
    surface = surfaces_of(model)[0]
    vertices, _ = decoded(surface.content())
    step = np.ptp(surface.vertices_o, axis=0) / 65535
    steps_away, _ = KDTree(vertices / step).query(surface.vertices_o / step, p=np.inf)
    assert steps_away.max() <= 0.5 + 1e-6


def test_a_collision_mesh_is_shown_as_the_hull_that_the_engine_uses():
    shape = trimesh.creation.extrude_polygon(
        trimesh.path.polygons.Polygon(BENT), height=1.0, engine="earcut"
    )
    points = " ".join(f"{v:.9g}" for v in shape.vertices.reshape(-1))
    faces = " ".join(str(int(f)) for f in shape.faces.reshape(-1))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="bent" vertex="{points}" face="{faces}"/></asset><worldbody>'
        '<body><geom type="mesh" mesh="bent"/></body></worldbody></mujoco>'
    )
    seen = triangles_of(model, 0, "visual")
    touched = triangles_of(model, 0, "collision")
    assert seen is not None
    assert touched is not None
    assert area_and_volume(*seen)[1] == pytest.approx(3.0, rel=1e-6)
    assert area_and_volume(*touched)[1] == pytest.approx(3.5, rel=1e-6)


def test_what_is_too_fine_is_made_coarser_but_stays_in_its_box(tmp_path):
    asset = make_object(tmp_path / "a")
    asset.mjcf_path.write_text(BALL, encoding="utf-8")
    model = load_model(asset)
    fine = surfaces_of(model)[0]
    coarse = surfaces_of(model, {"visual": 300, "collision": 300})[0]
    assert len(fine.faces) > 1000
    assert 100 < len(coarse.faces) <= 300
    assert (np.abs(coarse.vertices_o).max(axis=0) <= np.abs(fine.vertices_o).max(axis=0)).all()
    assert area_and_volume(coarse.vertices_o, coarse.faces)[1] == pytest.approx(
        area_and_volume(fine.vertices_o, fine.faces)[1], rel=0.15
    )


def test_a_joint_without_end_gets_a_slider_of_one_turn(tmp_path):
    endless = Part(name="tap", kind="hinge", axis=(0, 0, 1), span=None, boxes=BOX)
    asset = make_object(tmp_path / "a", endless)
    assert slider_range(asset.joints[0]) == (0.0, 2.0 * np.pi)
    assert slider_range(make_cabinet(tmp_path / "b").joints[0]) == (0.0, 0.28)


def test_a_joint_that_opens_downwards_begins_on_the_left_too(tmp_path):
    asset = make_object(
        tmp_path / "a",
        Part(name="up", kind="slide", axis=(0, 0, 1), span=0.3, boxes=BOX),
        Part(name="down", kind="slide", axis=(0, 0, 1), span=-0.3, boxes=BOX),
    )
    inputs = re.findall(r"<input [^>]*>", viewer_html(load_model(asset)))
    assert ['dir="rtl"' in text for text in inputs] == [False, True]


def test_the_camera_stands_where_the_object_opens_to(tmp_path):
    """The drawers and the door of the test objects come out along -x, so one looks along +x."""
    assert front_azimuth_deg(make_cabinet(tmp_path / "a")) == pytest.approx(0.0, abs=1e-6)
    assert front_azimuth_deg(make_cupboard(tmp_path / "b")) == pytest.approx(0.0, abs=45.0)
    lid = Part(name="lid", kind="slide", axis=(0, 0, 1), boxes=BOX)
    assert front_azimuth_deg(make_object(tmp_path / "c", lid)) == 90.0


def test_the_camera_stands_before_sliding_doors(tmp_path):
    """They move along the front, to which their handles point."""
    asset = make_cabinet(tmp_path / "a")
    joints = tuple(replace(joint, axis_o=(0.0, 1.0, 0.0)) for joint in asset.joints)
    sideways = replace(asset, joints=joints)
    assert front_azimuth_deg(sideways) == pytest.approx(0.0, abs=1e-6)
    assert front_azimuth_deg(replace(sideways, handles=())) == pytest.approx(-90.0)


def test_no_name_ends_the_element_that_it_stands_in(tmp_path):
    evil = "a</script><script>alert(1)</script>"
    asset = make_object(tmp_path / "a", Part(name="lid", kind="hinge", axis=(0, 1, 0), boxes=BOX))
    subject = load_model(asset)
    text = viewer_html(subject, {"lid_joint": (evil,)})
    object.__setattr__(subject.asset, "name", evil)
    told = viewer_html(subject)
    assert "alert(1)</script>" not in text + told
    data = re.search(r'id="viewer-data">(.*?)</script>', told, re.DOTALL)
    assert data is not None
    assert json.loads(data[1])["name"] == evil


# In a browser.


def page_of(asset, path):
    page = ReportPage(asset.name)
    page.view(viewer_html(load_model(asset)))
    return page.save(path)


@pytest.fixture(scope="module")
def browser():
    with Browser(width=390, height=800, phone=True) as browser:
        yield browser


def slide_to(browser, joint, value):
    """Move the slider of ``joint`` as a hand would."""
    name = json.dumps(f'input[data-joint="{joint}"]')
    browser.run(
        f"(() => {{ const input = document.querySelector({name}); input.value = {value!r};"
        "input.dispatchEvent(new Event('input')); })()"
    )


def pose_in(browser, link):
    return np.array(browser.run(f"articulate.pose({json.dumps(link)})")).reshape(4, 4)


@pytest.mark.render
@pytest.mark.parametrize("make", [make_cabinet, make_cupboard])
def test_a_slider_moves_its_part_to_where_the_asset_says(tmp_path, browser, make):
    asset = make(tmp_path / "a")
    browser.open(page_of(asset, tmp_path / "page.html"))
    for joint in asset.joints:
        for share in (0.0, 0.37, 1.0):
            q = joint.closed + share * joint.span
            slide_to(browser, joint.name, q)
            assert pose_in(browser, joint.link) == pytest.approx(
                asset.T_ol(joint.name, q), abs=1e-9
            )
        slide_to(browser, joint.name, joint.closed)
    assert browser.problems == []


@pytest.mark.render
def test_chains_and_followers_stand_where_the_simulator_puts_them(tmp_path, browser):
    asset = make_object(
        tmp_path / "a",
        Part(name="arm", kind="hinge", axis=(0, 0, 1), pos=(0.3, 0.1, 0.2), span=1.5, boxes=BOX),
        Part(
            name="tray",
            kind="slide",
            axis=(0, 0.6, 0.8),
            pos=(0.1, 0, 0.1),
            parent="arm",
            boxes=BOX,
        ),
        Part(name="twin", kind="hinge", axis=(1, 0, 0), boxes=BOX, span=1.5, follows="arm"),
    )
    model = load_model(asset)
    data = model.data()
    browser.open(page_of(asset, tmp_path / "page.html"))
    q = {"arm_joint": 1.1, "tray_joint": 0.25}
    for name, value in q.items():
        slide_to(browser, name, value)
    model.set_joints(data, q)
    for link in ("body", "arm", "tray", "twin"):
        assert pose_in(browser, link) == pytest.approx(model.T_ol(data, link), abs=1e-9)
    assert browser.run("articulate.get('twin_joint')") == pytest.approx(1.1)
    assert browser.run("document.querySelector('input[data-joint=twin_joint]').disabled")
    assert browser.problems == []


@pytest.mark.render
def test_a_finger_pulls_a_door_open_and_turns_what_is_behind(tmp_path, browser):
    """The middle of the door comes towards the eye: to the left and down, as it is seen."""
    asset = make_cupboard(tmp_path / "a")
    browser.open(page_of(asset, tmp_path / "page.html"))
    x, y, width, height = browser.run(
        "(b => [b.left, b.top, b.width, b.height])"
        "(document.querySelector('canvas').getBoundingClientRect())"
    )
    assert browser.run("articulate.drawn()") > 20  # triangles: something is to be seen
    opened = "articulate.get('door_hinge')"
    assert browser.run(opened) == 0.0
    middle = (x + 0.48 * width, y + 0.5 * height)
    browser.touch(middle, (middle[0] - 50.0, middle[1] + 30.0))
    pulled = browser.run(opened)
    assert 0.2 < pulled < asset.joints[0].open
    corner = (x + 0.03 * width, y + 0.3 * height)
    browser.touch(corner, (corner[0] + 60.0, corner[1]))
    assert browser.run(opened) == pulled
    assert browser.problems == []
