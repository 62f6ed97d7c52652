from __future__ import annotations

import json
import struct

import numpy as np
import pytest
import trimesh
from tests.articulate.reconstruct.scan.scan_objects import box, double_doors, merged, write

from articulate.errors import UsageError
from articulate.reconstruct.result import MakeRequest
from articulate.reconstruct.scan.make_scan import make_scan, scan_parts
from articulate.reconstruct.scan.read_scan import ScanHints, read_scan


def make(tmp_path, name, **hints):
    request = MakeRequest(out=tmp_path / "asset", cache=tmp_path / "cache")
    return make_scan(tmp_path / name, request, ScanHints(**hints))


def one_triangle(path):
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 1]], [[0, 1, 2]]).export(path)


def ten_million(path):
    header = b"\0" * 80 + struct.pack("<I", 10_000_000)
    with path.open("wb") as file:
        file.write(header)
        file.truncate(84 + 50 * 10_000_000)


def ten_million_stated(path):
    accessor = {"componentType": 5126, "count": 30_000_000, "type": "VEC3"}
    text = json.dumps({"asset": {"version": "2.0"}, "accessors": [accessor]})
    path.write_text(text, encoding="utf-8")


def not_finite(path):
    mesh = box((0, 0, 0), (1, 1, 1))
    mesh.vertices[3] = np.nan
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in mesh.vertices)
    text += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in mesh.faces)
    path.write_text(text, encoding="utf-8")


def two_objects(path):
    apart = box((3, 0, 0), (4, 1, 1))
    trimesh.util.concatenate([box((0, 0, 0), (1, 1, 1)), apart]).export(path)


def flat(path):
    trimesh.creation.box((1, 1, 1e-9)).subdivide().export(path)


def plain_box(path):
    trimesh.creation.icosphere(subdivisions=3).export(path)


def another_type(path):
    path.write_bytes(b"%PDF-1.7 not a mesh")


def draco(path):
    required = {"asset": {"version": "2.0"}, "extensionsRequired": ["EXT_meshopt_compression"]}
    path.write_text(json.dumps(required), encoding="utf-8")


@pytest.mark.parametrize(
    ("provoke", "name"),
    [
        (one_triangle, "triangle.stl"),
        (ten_million, "large.stl"),
        (ten_million_stated, "large.gltf"),
        (not_finite, "nan.obj"),
        (two_objects, "two.stl"),
        (flat, "flat.stl"),
        (plain_box, "ball.stl"),
        (another_type, "paper.glb"),
        (another_type, "paper.pdf"),
        (draco, "compressed.gltf"),
        (lambda path: None, "absent.glb"),
    ],
)
def test_bad_meshes_give_one_line(tmp_path, error_line, provoke, name):
    provoke(tmp_path / name)
    error_line(f"make_scan({name!r}, {provoke.__name__})", lambda: make(tmp_path, name))
    assert not (tmp_path / "asset").exists()


def test_sizes_without_a_unit_are_assumed(tmp_path):
    mesh, _ = merged(*double_doors())
    path = write(mesh.transformed(np.eye(3), 15.0, np.zeros(3)), tmp_path / "cabinet.glb")
    scan = read_scan(path, ScanHints())
    assert scan.mesh.size.max() == pytest.approx(0.5)
    assert any("unit of the file is unknown" in text for text in scan.assumptions)
    known = read_scan(path, ScanHints(text="a kitchen cabinet"))
    assert (known.category, known.mesh.size.max()) == ("StorageFurniture", pytest.approx(0.8))
    assert read_scan(path, ScanHints(height_m=1.2)).mesh.size[2] == pytest.approx(1.2)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1000.0), ("cm", 100.0)])
def test_units_are_detected_by_size(tmp_path, unit, scale):
    mesh, _ = merged(*double_doors())
    longest_m = mesh.size.max()
    path = write(mesh.transformed(np.eye(3), scale, np.zeros(3)), tmp_path / "cabinet.glb")
    scan = read_scan(path, ScanHints())
    assert scan.mesh.size.max() == pytest.approx(longest_m)
    assert any(text.startswith(f"the file is in {unit}:") for text in scan.assumptions)


def test_large_meshes_are_simplified(tmp_path, monkeypatch):
    monkeypatch.setattr("articulate.reconstruct.scan.read_scan.MANY_FACES", 1000)
    trimesh.creation.icosphere(subdivisions=5).export(tmp_path / "ball.stl")
    scan = read_scan(tmp_path / "ball.stl", ScanHints())
    assert len(scan.mesh.faces) <= 20480
    assert any("simplified" in text for text in scan.assumptions)


def masked(tmp_path, content, suffix=".json"):
    mesh, label = merged(*double_doors())
    path = write(mesh, tmp_path / "cabinet.glb")
    masks = tmp_path / f"masks{suffix}"
    if suffix == ".npz":
        np.savez(masks, **content(label))
    else:
        masks.write_text(json.dumps(content(label)), encoding="utf-8")
    hints = ScanHints(masks=masks)
    return scan_parts(read_scan(path, hints), path, hints)


@pytest.mark.parametrize(
    ("suffix", "content"),
    [
        (".npz", lambda label: {"labels": label + 1, "names": np.array(["door", "door"])}),
        (".json", lambda label: {"labels": (label + 1).tolist(), "names": ["door", "door"]}),
        (
            ".json",
            lambda label: {
                "parts": [
                    {"name": "door", "faces": np.flatnonzero(label == k).tolist()} for k in (0, 1)
                ]
            },
        ),
    ],
)
def test_masks_override_the_segmentation(tmp_path, suffix, content):
    found = masked(tmp_path, content, suffix)
    moving = {joint.part: joint.kind for joint in found.joints if joint.kind != "fixed"}
    assert moving == {"door_1": "revolute", "door_2": "revolute"}


@pytest.mark.parametrize(
    ("call", "content"),
    [
        ("masks with another number of labels", lambda label: {"labels": [0, 1]}),
        ("masks without a part", lambda label: {"labels": [0] * len(label)}),
        ("masks without a body", lambda label: {"labels": [1] * len(label)}),
        ("masks with text", lambda label: {"labels": ["door"] * len(label)}),
        ("masks with a face too many", lambda label: {"parts": [{"name": "a", "faces": [9999]}]}),
    ],
)
def test_bad_masks_give_one_line(tmp_path, error_line, call, content):
    error_line(call, lambda: masked(tmp_path, content))


def test_a_video_needs_no_scan():
    from articulate.commands.make import MakeFlags

    for flags in ({"masks": "m.npz"}, {"scan": "a.glb", "parts": "b"}):
        with pytest.raises(UsageError):
            MakeFlags(**flags)  # type: ignore[arg-type]
