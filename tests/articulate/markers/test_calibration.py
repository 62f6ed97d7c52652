"""Cameras, their poses and objects from rendered images, and the sets of images that do not do."""

import dataclasses
import json
import re
from typing import Any

import cv2
import numpy as np
import pytest

from articulate.config import to_plain
from articulate.markers.base_calibration import GripperView, calibrate_base, park_martin
from articulate.markers.camera_calibration import (
    CameraCalibration,
    CameraPose,
    load_calibration,
    load_camera_pose,
    save_calibration,
    save_camera_pose,
)
from articulate.markers.camera_device import OpenCvCamera, image_files, read_gray
from articulate.markers.charuco import Board, BoardDetector, BoardView, calibrate_camera
from articulate.markers.detection import marker_poses
from articulate.markers.gripper_poses import load_gripper_views
from articulate.markers.layout import SQUARE, Marker, load_layout, save_layout
from articulate.markers.locate import locate_object
from articulate.markers.object_fit import pose_difference
from articulate.markers.sheets import board_pages, marker_pages, pdf_of
from articulate.markers.synthetic_images import Plane, marker_plane, render_planes
from articulate.render.camera import look_at
from articulate.robot.arm import PANDA
from articulate.robot.kinematics import tool_pose
from articulate.transforms import apply, axis_angle_to_matrix, inverse, matrix_to_quat, pose
from marker_scenes import HD, marked_object, render_object

VGA = CameraCalibration(
    camera="webcam",
    width_px=640,
    height_px=480,
    matrix=((520.0, 0.0, 325.0), (0.0, 522.0, 236.0), (0.0, 0.0, 1.0)),
    distortion=(0.08, -0.12, 0.001, -0.0005, 0.0),
)
BOARD = Board()
CENTER_B = 0.5 * BOARD.square_m * np.array([BOARD.columns, BOARD.rows])


def board_pose(rng, spread=1.0):
    tilt = axis_angle_to_matrix((0, 0, 1), rng.uniform(-3, 3))
    axis = np.array([*rng.normal(size=2), 0.0])
    turn = axis_angle_to_matrix(axis / np.linalg.norm(axis), spread * rng.uniform(0.2, 0.6))
    distance = rng.uniform(0.3, 0.55)
    shift = spread * distance * rng.uniform(-0.4, 0.4, 2) * (1.0, 0.75)
    return pose((*shift, distance), turn @ tilt @ np.diag([1.0, -1.0, -1.0]))


def exact_views(n, rng, spread=1.0):
    """Corners of the board without images, those inside the image."""
    points = np.asarray(BOARD.opencv().getChessboardCorners(), dtype=np.float64)
    flipped = (points - (*CENTER_B, 0.0)) * (1, -1, 1)
    views = []
    for k in range(n):
        uv = VGA.projected(apply(board_pose(rng, spread), flipped))
        uv += 0.05 * rng.normal(size=uv.shape)
        inside = ((uv > 0) & (uv < (640, 480))).all(axis=1)
        if inside.sum() >= 8:
            views.append(BoardView(f"{k}.png", points[inside], uv[inside]))
    return views


def board_image(T_cb, rng):
    px = 60
    texture = BOARD.opencv().generateImage((BOARD.columns * px, BOARD.rows * px))
    size = (BOARD.columns * BOARD.square_m, BOARD.rows * BOARD.square_m)
    return render_planes(VGA, [Plane(np.asarray(texture), size, T_cb)], rng, samples=2)


def test_a_camera_is_calibrated_from_corners():
    found = calibrate_camera(exact_views(25, np.random.default_rng(0)), (640, 480), "w", images=25)
    assert found.error_px < 0.2
    assert found.coverage > 0.6
    assert np.allclose(found.K, VGA.K, atol=4.0)


def test_a_board_is_found_in_an_image_to_a_tenth_of_a_pixel():
    rng = np.random.default_rng(3)
    T_cb = pose((0.0, 0.0, 0.4), axis_angle_to_matrix((1, 0, 0), 0.4) @ np.diag([1.0, -1.0, -1.0]))
    view = BoardDetector(BOARD).detect(board_image(T_cb, rng), "a.png")
    assert view is not None
    exact = VGA.projected(apply(T_cb, (view.points_b - (*CENTER_B, 0.0)) * (1, -1, 1)))
    assert len(view.uv) == (BOARD.columns - 1) * (BOARD.rows - 1)
    assert np.linalg.norm(view.uv - exact, axis=1).mean() < 0.15
    blank = np.full((480, 640), 200, dtype=np.uint8)
    assert BoardDetector(BOARD).detect(blank, "b.png") is None


def test_bad_sets_of_images_are_errors(error_line):
    rng = np.random.default_rng(1)
    good = exact_views(30, rng)
    narrow = [dataclasses.replace(v, uv=300 + 0.1 * v.uv) for v in good]
    parallel = []
    points = np.asarray(BOARD.opencv().getChessboardCorners(), dtype=np.float64)
    for k in range(12):
        shift = (-0.12 + 0.08 * (k % 4), -0.08 + 0.08 * (k // 4), 0.45)
        flat = pose(shift, np.diag([1.0, -1.0, -1.0]))
        uv = VGA.projected(apply(flat, (points - (*CENTER_B, 0.0)) * (1, -1, 1)))
        parallel.append(BoardView(f"{k}", points, uv))
    wrong = [dataclasses.replace(v, uv=v.uv + rng.normal(size=v.uv.shape) * 4) for v in good]
    for name, views in {
        "no board": [],
        "3 views": good[:3],
        "narrow": narrow,
        "parallel": parallel,
        "noisy": wrong,
    }.items():
        error_line(
            f"calibrate_camera({name})",
            lambda views=views: calibrate_camera(views, (640, 480), "w", images=30),
        )


def gripper_views(n, rng, sigma_px=0.05, turn=0.5):
    """Marker on the gripper before a fixed camera, in arm poses around one."""
    T_tm = pose((0.0, 0.03, -0.05), axis_angle_to_matrix((1, 0, 0), -2.0))
    middle = np.array([0.1, 0.0, 0.1, -2.2, 0.1, 2.3, 0.8])
    T_wm = tool_pose(PANDA, middle) @ T_tm
    eye = T_wm[:3, 3] + 0.6 * T_wm[:3, 2] + (0.05, 0.1, 0.0)
    T_wc = look_at(eye, T_wm[:3, 3])
    views = []
    for k in range(n):
        q = middle + turn * rng.uniform(-1, 1, 7) * (0.2, 0.3, 0.3, 0.3, 0.7, 0.7, 0.9)
        T_cm = inverse(T_wc) @ tool_pose(PANDA, q) @ T_tm
        corners = HD.projected(apply(T_cm, 0.04 * SQUARE)) + sigma_px * rng.normal(size=(4, 2))
        found = marker_poses(corners, 0.04, HD.K, HD.dist)[0].T_cm
        views.append(GripperView(f"{k}", tool_pose(PANDA, q), found, corners))
    return views, T_wc, T_tm


def test_the_pose_of_a_camera_follows_from_arm_poses():
    views, T_wc, T_tm = gripper_views(15, np.random.default_rng(0))
    found, on_tool = calibrate_base(views, HD, 0.04)
    error = pose_difference(T_wc, found.T_wc)
    assert np.linalg.norm(error[:3]) < 0.004
    assert np.linalg.norm(error[3:]) < np.radians(0.4)
    assert np.linalg.norm(pose_difference(T_tm, on_tool)[:3]) < 0.002
    assert found.error_m < 0.004


def test_park_and_martin_are_exact_without_noise():
    rng = np.random.default_rng(2)

    def random_pose():
        axis = rng.normal(size=3)
        return pose(rng.normal(size=3), axis_angle_to_matrix(axis / np.linalg.norm(axis), 1.0))

    X = random_pose()
    motions_b = [random_pose() for _ in range(4)]
    motions_a = [X @ B @ inverse(X) for B in motions_b]
    assert np.allclose(park_martin(motions_a, motions_b), X, atol=1e-9)


def test_arm_poses_that_do_not_do_are_errors(error_line):
    views, _, _ = gripper_views(12, np.random.default_rng(1))
    mixed = [dataclasses.replace(v, T_wt=views[(k * 5) % 12].T_wt) for k, v in enumerate(views)]
    similar, _, _ = gripper_views(12, np.random.default_rng(1), turn=0.05)
    for name, some in {"3 poses": views[:3], "similar": similar, "mixed up": mixed}.items():
        error_line(f"calibrate_base({name})", lambda some=some: calibrate_base(some, HD, 0.04))


def test_poses_are_read_from_a_file(tmp_path, error_line):
    views, T_wc, T_tm = gripper_views(3, np.random.default_rng(0))
    marker = Marker(id=2, link="gripper", size_m=0.04, center_m=(0, 0, 0), normal=(1, 0, 0))
    rng = np.random.default_rng(0)
    plane = marker_plane("4x4_50", marker, inverse(T_wc) @ views[0].T_wt @ T_tm)
    cv2.imwrite(str(tmp_path / "0.png"), render_planes(HD, [plane], rng))
    q = [0.0] * 7
    file = tmp_path / "poses.json"
    file.write_text(json.dumps({"poses": [{"image": "0.png", "q": q}]}))
    found, count = load_gripper_views(file, HD, 2, 0.04, "4x4_50")
    assert count == 1
    assert np.linalg.norm(pose_difference(plane.T_cp, found[0].T_cm)[:3]) < 0.003
    assert load_gripper_views(file, HD, 3, 0.04, "4x4_50") == ([], 1)
    file.write_text(json.dumps({"poses": [{"image": "0.png", "q": q[1:]}]}))
    error_line(
        "load_gripper_views(6 angles)", lambda: load_gripper_views(file, HD, 2, 0.04, "4x4_50")
    )


def located(thing, images, calibration=HD, layout=None):
    x, y, z = thing.T_wc[:3, 3]
    quat: Any = tuple(matrix_to_quat(thing.T_wc[:3, :3]).tolist())
    at = CameraPose(camera="rendered", pos_w=(x, y, z), quat_w=quat)
    return locate_object(images, thing.asset, thing.joint, layout or thing.layout, calibration, at)


def test_an_object_is_located_and_what_prevents_it_is_named(error_line):
    thing = marked_object("slide", 4)
    rng = np.random.default_rng(4)
    image = render_object(thing, 0.05, rng)
    found = located(thing, [("a", image), ("b", render_object(thing, 0.05, rng))])
    x, y, z = thing.T_wo[:3, 3]
    assert np.allclose((found.pose.x_m, found.pose.y_m, found.pose.z_m), (x, y, z), atol=0.004)
    yaw = np.degrees(np.arctan2(thing.T_wo[1, 0], thing.T_wo[0, 0]))
    assert abs((found.pose.yaw_deg - yaw + 180) % 360 - 180) < 0.5
    assert found.joints["part_joint"] == pytest.approx(0.05, abs=0.002)
    blank = np.full((720, 1280), 180, dtype=np.uint8)
    other = dataclasses.replace(
        thing.layout,
        markers=tuple(dataclasses.replace(m, id=m.id + 7) for m in thing.layout.markers),
    )
    error_line("locate_object(blank)", lambda: located(thing, [("a", blank)]))
    error_line("locate_object(other ids)", lambda: located(thing, [("a", image)], layout=other))
    covered = render_object(thing, 0.05, rng, covered=(0,))
    error_line("locate_object(body covered)", lambda: located(thing, [("a", covered)]))
    error_line("locate_object(640x480)", lambda: located(thing, [("a", blank[:480, :640])]))
    wrong = dataclasses.replace(
        thing.layout,
        markers=tuple(dataclasses.replace(m, up=(0.0, 1.0, 0.3)) for m in thing.layout.markers),
    )
    error_line("locate_object(wrong up)", lambda: located(thing, [("a", image)], layout=wrong))


def test_files_are_read_as_written_and_others_are_errors(tmp_path, error_line):
    save_calibration(tmp_path / "c.json", VGA)
    assert load_calibration(tmp_path / "c.json") == VGA
    at = CameraPose(camera="webcam", pos_w=(1.0, 0.0, 0.5), quat_w=(1.0, 0.0, 0.0, 0.0))
    save_camera_pose(tmp_path / "p.json", at)
    assert load_camera_pose(tmp_path / "p.json") == at
    layout = marked_object("slide").layout
    save_layout(tmp_path / "l.yaml", layout)
    assert load_layout(tmp_path / "l.yaml") == layout
    error_line("load_calibration(p.json)", lambda: load_calibration(tmp_path / "p.json"))
    error_line("check_camera(other)", lambda: VGA.check_camera("realsense"))
    content = to_plain(layout)
    del content["markers"][1]["size_m"]
    (tmp_path / "l.yaml").write_text(json.dumps(content))
    error_line("load_layout(size_m is missing)", lambda: load_layout(tmp_path / "l.yaml"))
    error_line("image_files(absent)", lambda: image_files([tmp_path / "absent"]))
    (tmp_path / "empty").mkdir()
    error_line("image_files(empty)", lambda: image_files([tmp_path / "empty"]))
    error_line("read_gray(json)", lambda: read_gray(tmp_path / "c.json"))


@pytest.mark.filterwarnings("ignore")
def test_a_camera_that_is_absent_is_an_error(error_line):
    error_line("OpenCvCamera(97)", lambda: OpenCvCamera("97", "webcam"))


def test_sheets_have_exact_sizes_and_equal_bytes(error_line):
    pages = marker_pages(tuple(range(20)), 40.0, "4x4_50", "a4")
    assert sum(map(len, pages)) == 20
    for page in pages:
        for item in page:
            assert item.width_mm == item.height_mm == 40.0
            assert 10.0 < item.left_mm < 210.0 - 50.0
            assert 30.0 < item.bottom_mm < 297.0 - 50.0
    content = pdf_of(pages[:1], "a4")
    assert content == pdf_of(pages[:1], "a4")
    box = re.search(rb"/MediaBox \[ 0 0 (\S+) (\S+) \]", content)
    assert box is not None
    assert [float(v) / 72 * 25.4 for v in box.groups()] == pytest.approx([210.0, 297.0], abs=0.01)
    (board,) = board_pages(Board(), "a4")[0]
    assert (board.width_mm, board.height_mm) == (175.0, 245.0)
    error_line("marker_pages(300 mm)", lambda: marker_pages((0,), 300.0, "4x4_50", "a4"))
    error_line("marker_pages(id 50)", lambda: marker_pages((50,), 40.0, "4x4_50", "a4"))
    error_line("board_pages(60 mm)", lambda: board_pages(Board(square_m=0.06), "a4"))


def test_views_of_a_moved_board_are_recorded(monkeypatch):
    from articulate.markers import capture

    views = exact_views(6, np.random.default_rng(5))

    class Device:
        def __init__(self, *_):
            self.k = 0

        def read(self):
            self.k += 1
            return type("F", (), {"image": np.zeros((480, 640), np.uint8)})

        def close(self):
            pass

    monkeypatch.setattr(capture, "OpenCvCamera", Device)
    monkeypatch.setattr(capture, "MAX_FRAMES", 40)
    shown: list[str] = []
    detect = lambda image, name: views[int(name.split()[1]) // 4 % len(views)]  # noqa: E731
    found, size_px, frames = capture.record_views("0", "w", None, 4, detect, shown.append)
    assert (len(found), size_px, frames) == (4, (640, 480), 13)
    assert len(shown) == 4
    assert len(capture.record_images("0", "w", None, 3)) == 3
