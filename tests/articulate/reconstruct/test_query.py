from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from articulate.errors import UsageError
from articulate.reconstruct.query import (
    QueryCamera,
    image_query,
    read_camera,
    text_query,
    video_query,
)
from articulate.render.camera import front_camera
from articulate.render.joint_video import Video


def frames(moving):
    out = np.full((12, 96, 128, 3), 240, dtype=np.uint8)
    for k, frame in enumerate(out):
        at = 10 + (4 * k if moving else 0)
        frame[30:60, at : at + 30] = (200, 30, 30)
    return out


def clip(path, pictures):
    return Video(frames=pictures, times_s=np.arange(len(pictures)) / 24.0).write(path)


def test_a_clip_keeps_its_frames_and_size(tmp_path):
    query = video_query(clip(tmp_path / "a.mp4", frames(moving=True)), "a slide")
    assert query.size_px == (128, 96)
    assert (query.modality, query.text) == ("video", "a slide")


def test_clips_that_show_nothing_are_refused(tmp_path, error_line):
    still = clip(tmp_path / "still.mp4", frames(moving=False))
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "letter.mp4").write_text("Dear Sir")
    one = clip(tmp_path / "one.mp4", frames(moving=True)[:1])
    for path in (still, one, tmp_path / "empty.mp4", tmp_path / "letter.mp4", tmp_path / "no.mp4"):
        error_line(f"video_query({path.name})", lambda p=path: video_query(p))


def test_a_picture_is_read_in_rgb(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), frames(moving=True)[0][..., ::-1])
    query = image_query(tmp_path / "a.png")
    assert query.image is not None
    assert query.image[40, 20].tolist() == [200, 30, 30]


def test_pictures_without_an_object_are_refused(tmp_path, error_line):
    cv2.imwrite(str(tmp_path / "white.png"), np.full((60, 80, 3), 250, np.uint8))
    (tmp_path / "empty.png").touch()
    (tmp_path / "letter.png").write_text("Dear Sir")
    cv2.imwrite(str(tmp_path / "line.png"), np.full((1, 30_000, 3), 250, np.uint8))
    for name in ("white.png", "empty.png", "letter.png", "no.png", "line.png"):
        error_line(f"image_query({name})", lambda n=name: image_query(tmp_path / n))


def test_a_picture_that_is_too_large_is_refused_before_it_is_decoded(
    tmp_path, monkeypatch, error_line
):
    Image.new("L", (11_000, 10_000)).save(tmp_path / "large.png")
    monkeypatch.setattr(cv2, "imdecode", None)
    error_line("image_query(large.png)", lambda: image_query(tmp_path / "large.png"))
    Image.new("1", (20_000, 10_000)).save(tmp_path / "bomb.png")
    with pytest.raises(UsageError, match="100 million pixels"):
        image_query(tmp_path / "bomb.png")


def test_a_name_that_is_too_long_is_refused():
    for read in (image_query, video_query):
        with pytest.raises(UsageError):
            read(Path("x" * 300))


def test_text_says_something(error_line):
    assert text_query("  a\n box ").text == "a box"
    for text in ("", " \n", "!?"):
        error_line("text_query('')", lambda t=text: text_query(t))
    error_line("text_query(long)", lambda: text_query("box " * 1000))
    error_line("text_query(not UTF-8)", lambda: text_query("a \udcff box"))


def test_the_camera_of_the_benchmark_is_the_usual_one(tmp_path):
    ours, theirs = QueryCamera().camera(640, 480), front_camera()
    np.testing.assert_allclose(ours.T_wc, theirs.T_wc)
    np.testing.assert_allclose(ours.matrix, theirs.matrix)


def camera_file(path, **changes):
    camera = front_camera()
    content = {
        **{k: getattr(camera, k) for k in ("width_px", "height_px", "fx_px", "fy_px")},
        **{"cx_px": camera.cx_px, "cy_px": camera.cy_px, "T_oc": camera.T_wc.tolist()},
    }
    path.write_text(json.dumps({**content, **changes}))
    return path


def test_a_camera_is_read_from_a_file_and_fitted_to_the_picture(tmp_path):
    path = camera_file(tmp_path / "camera.json")
    np.testing.assert_allclose(read_camera(path).T_wc, front_camera().T_wc)
    half = QueryCamera(file=path).camera(320, 240)
    assert half.fx_px == pytest.approx(0.5 * front_camera().fx_px)


def test_what_is_no_camera_is_refused(tmp_path, error_line):
    bad = camera_file(tmp_path / "flat.json", T_oc=np.ones((4, 4)).tolist())
    (tmp_path / "list.json").write_text("[]")
    (tmp_path / "part.json").write_text('{"T_oc": 1}')
    for name in (bad.name, "list.json", "part.json", "no.json"):
        error_line(f"read_camera({name})", lambda n=name: read_camera(tmp_path / n))
    pose = front_camera().T_wc
    for name, changes in {
        "endless.json": {"width_px": float("inf")},
        "unfocused.json": {"fx_px": float("nan")},
        "beside.json": {"cx_px": float("inf")},
        "mirror.json": {"T_oc": (pose @ np.diag([-1.0, 1.0, 1.0, 1.0])).tolist()},
        "row.json": {"T_oc": [*pose[:3].tolist(), [0.0, 0.0, 0.5, 1.0]]},
    }.items():
        told = camera_file(tmp_path / name, **changes)
        error_line(f"read_camera({name})", lambda p=told: read_camera(p))
    (tmp_path / "deep.json").write_text("[" * 100_000)
    error_line("camera_in(deep.json)", lambda: read_camera(tmp_path / "deep.json"))
    wide = camera_file(tmp_path / "camera.json")
    error_line(
        "View(camera.json).camera(640, 200)", lambda: QueryCamera(file=wide).camera(640, 200)
    )
    error_line("View(fovy=0)", lambda: QueryCamera(fovy=0.0))
