"""Damaged and hostile inputs of a reconstruction end with one short line, or are ignored."""

import json
import os
import struct
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from articulate.benchmark.dataset import open_dataset
from articulate.errors import UsageError
from articulate.reconstruct.part_set import read_part_set
from articulate.reconstruct.query import image_query, read_camera, text_query, video_query

MAX_LINE = 700
MAX_S = 20.0


def rejected(read):
    """The line that reading ends with."""
    start = time.process_time()
    with pytest.raises(UsageError) as caught:
        read()
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) <= MAX_LINE
    assert time.process_time() - start < MAX_S
    return line


def zero(path):
    path.symlink_to("/dev/zero")


def nested(path):
    path.write_text("[" * 100_000)


def huge(path):
    with path.open("wb") as stream:
        stream.truncate(3_000_000_000)


FILES: dict[str, Callable[[Path], object]] = {
    "fifo": os.mkfifo,
    "zero": zero,
    "nested": nested,
    "folder": os.mkdir,
    "huge": huge,
    "binary": lambda path: path.write_bytes(bytes(range(256)) * 40),
    "list": lambda path: path.write_text("[1, 2]"),
    "nan": lambda path: path.write_text('{"T_oc": NaN, "assets": [NaN]}'),
    "long": lambda path: path.write_text(json.dumps({"x" * 100_000: "y" * 100_000})),
}
READERS: dict[str, Callable[[Path], object]] = {
    "camera.json": read_camera,
    "image.png": image_query,
    "video.mp4": video_query,
    "parts.glb": read_part_set,
    "parts.urdf": read_part_set,
    "index.json": lambda path: open_dataset(str(path)),
}


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("name", READERS)
def test_a_file_that_is_not_what_it_should_be_is_rejected(tmp_path, name, kind):
    path = tmp_path / name
    FILES[kind](path)
    rejected(lambda: READERS[name](path))


@pytest.fixture
def folder(tmp_path):
    """Two boxes as a folder of parts."""
    parts = tmp_path / "parts"
    parts.mkdir()
    for k, name in enumerate(("body", "door_2")):
        box = trimesh.creation.box((1.0, 0.1 + k, 1.0))
        box.apply_translation((k, 0.0, 0.5))
        box.export(parts / f"{name}.obj")
    return parts


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("name", ["labels.json", "semantics.txt"])
def test_labels_that_cannot_be_read_are_ignored(folder, name, kind):
    FILES[kind](folder / name)
    start = time.process_time()
    assert dict(read_part_set(folder).labels) == {"body": "body", "door_2": "door"}
    assert time.process_time() - start < MAX_S


@pytest.mark.parametrize("kind", ["nested", "binary", "list"])
def test_a_part_that_is_no_mesh_is_rejected(folder, kind):
    FILES[kind](folder / "drawer.stl")
    rejected(lambda: read_part_set(folder))


@pytest.mark.parametrize("kind", ["fifo", "zero", "folder"])
def test_what_is_no_regular_file_is_no_part(folder, kind):
    FILES[kind](folder / "drawer.stl")
    assert [mesh.name for mesh in read_part_set(folder).meshes] == ["body", "door_2"]


def test_a_part_with_vertices_that_are_not_finite_is_rejected(folder):
    header, count = bytes(80), struct.pack("<I", 1)
    triangle = np.full(12, np.nan, "<f4").tobytes() + b"\0\0"
    (folder / "drawer.stl").write_bytes(header + count + triangle)
    rejected(lambda: read_part_set(folder))


def test_too_many_parts_are_rejected(folder):
    content = (folder / "body.obj").read_bytes()
    for k in range(450):
        (folder / f"p{k}.obj").write_bytes(content)
    assert "at most 400" in rejected(lambda: read_part_set(folder))


def test_long_names_and_texts_are_shortened(tmp_path):
    rejected(lambda: read_part_set(tmp_path / ("x" * 5000)))
    rejected(lambda: image_query(tmp_path / ("x" * 5000)))
    rejected(lambda: text_query("door " * 100_000))
    assert len(text_query("door " * 300).description) < 250
