from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
import trimesh
from tests.articulate.benchmark.objects import LINKS, cupboard, write_index

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.export import write_questions
from articulate.commands.benchmark import main

CONFIG = BenchmarkConfig(actor="none", width_px=96, height_px=72, n_frames=4)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The object, and the folders of its questions."""
    folder = tmp_path_factory.mktemp("questions")
    subject = cupboard(tmp_path_factory.mktemp("data"))
    return subject, write_questions([subject], CONFIG, folder)


def test_a_question_is_a_folder_that_says_only_what_the_evidence_does(written):
    _, folders = written
    assert len(folders) == 4
    for folder in folders:
        names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
        parts = [f"parts/part_0{k}.glb" for k in range(5)]
        assert names == ["camera.json", "labels.json", *parts, "video.mp4"]


def test_no_byte_of_a_question_tells_an_id_or_a_link(written):
    _, folders = written
    for path in (p for folder in folders for p in folder.rglob("*") if p.is_file()):
        content = path.read_bytes()
        for telling in ("cupboard_77", *LINKS, "rotation", "translation", "mobility"):
            assert telling.encode() not in content


def test_the_parts_are_those_of_the_object_and_the_key_says_which(written):
    subject, folders = written
    key = json.loads((folders[0].parent / "key.json").read_text())[folders[0].name]
    assert key["object"] == "cupboard_77"
    for neutral, true in key["parts"].items():
        mesh = trimesh.load_mesh(folders[0] / "parts" / f"{neutral}.glb")
        assert np.allclose(mesh.bounds, subject.part(true).bounds, atol=1e-6)


def test_the_clip_has_its_frames_and_the_camera_its_pose(written):
    _, folders = written
    reader, count = cv2.VideoCapture(str(folders[0] / "video.mp4")), 0
    while reader.read()[0]:
        count += 1
    reader.release()
    camera = json.loads((folders[0] / "camera.json").read_text())
    assert count == 4
    assert np.array(camera["T_oc"])[:3, 3] == pytest.approx([3.0, 1.5, 2.0])


def test_the_command_writes_questions_and_asks_no_actor(tmp_path, capsys):
    index = write_index(tmp_path)
    out = tmp_path / "out"
    argv = [str(index), "--modality", "image", "--export", "--out", str(out), "--actor", "none"]
    assert main(argv) == 0
    assert "1 queries" in capsys.readouterr().out
    assert (out / "question_0000" / "image.png").is_file()
