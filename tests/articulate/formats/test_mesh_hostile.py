"""Mesh files that are meant to do harm: one line, little memory, little time."""

from __future__ import annotations

import json
import os
import resource
import struct
import time
from pathlib import Path
from typing import Any

import pytest
import trimesh

from articulate.errors import AssetError
from articulate.formats import mesh_file
from articulate.formats.mesh_file import MAX_FACES, load_scene, read_mesh
from articulate.formats.repairs import Repairs

MOST_CPU_S = 20.0
MOST_BYTES = 2_000_000_000


@pytest.fixture(autouse=True)
def limits() -> Any:
    """Less processor time and memory than a hostile file is after."""
    Path("/proc/self/clear_refs").write_text("5")  # the peak of earlier tests does not count
    before = time.process_time()
    yield
    assert time.process_time() - before < MOST_CPU_S
    assert peak_bytes() < MOST_BYTES


def peak_bytes() -> int:
    """Most memory of this process since its peak was reset [bytes]."""
    rows = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(row.split()[1]) for row in rows if row.startswith("VmHWM:"))


def rejected(path: Path, *words: str) -> str:
    with pytest.raises(AssetError) as caught:
        read_mesh(path, Repairs())
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 600
    assert any(word in line for word in words), line
    return line


def gltf(folder: Path, changes: dict[str, Any]) -> Path:
    """A triangle as glTF with its buffer beside it, ``changes`` made in its first accessor."""
    corners = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    (folder / "a.bin").write_bytes(corners)
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", **changes}
    header = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "a.bin", "byteLength": len(corners)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(corners)}],
        "accessors": [{k: v for k, v in accessor.items() if v is not None}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    path = folder / "a.gltf"
    path.write_text(json.dumps(header))
    return path


def as_glb(path: Path) -> Path:
    """The glTF file with its buffer in one GLB."""
    header = json.loads(path.read_text())
    del header["buffers"][0]["uri"]
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    data = path.with_name("a.bin").read_bytes()
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(data), 0x004E4942) + data
    out = path.with_suffix(".glb")
    out.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return out


@pytest.mark.parametrize("binary", [False, True])
def test_an_honest_gltf_is_read(tmp_path: Path, binary: bool) -> None:
    path = gltf(tmp_path, {})
    ((_, mesh, _),) = read_mesh(as_glb(path) if binary else path, Repairs())
    assert mesh.area == pytest.approx(0.5)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize(
    "changes",
    [
        {"bufferView": None, "count": 10**9},
        {"bufferView": None, "count": 10**9, "sparse": {"count": 1}},
        {"count": 10**9},
        {"count": 10**30},
        {"count": -5},
        {"count": "many"},
        {"count": None},
    ],
)
def test_accessors_of_any_size_are_rejected(
    tmp_path: Path, changes: dict[str, Any], binary: bool
) -> None:
    path = gltf(tmp_path, changes)
    rejected(as_glb(path) if binary else path, "count of accessor 0 is")


def test_many_accessors_and_primitives_of_one_buffer_are_rejected(tmp_path: Path) -> None:
    path = gltf(tmp_path, {"bufferView": None, "count": 8_000_000})
    header = json.loads(path.read_text())
    path.write_text(json.dumps({**header, "accessors": 20 * header["accessors"]}))
    rejected(path, "values in all accessors")
    primitives = [{"primitives": 30 * header["meshes"][0]["primitives"]}]
    path.write_text(json.dumps({**header, "meshes": primitives}))
    rejected(path, "items of all primitives")
    path.write_text(json.dumps({**header, "nodes": 20_001 * header["nodes"]}))
    rejected(path, "count of nodes")


@pytest.mark.parametrize("content", [b"[1]", b"[" * 100_000, b'{"meshes": 5}', b"\xff", b"glTF"])
def test_headers_that_are_no_object_are_rejected(tmp_path: Path, content: bytes) -> None:
    for name in ("a.gltf", "a.glb"):
        (tmp_path / name).write_bytes(content)
        rejected(tmp_path / name, "mesh a.gl")


def test_a_fifo_or_a_device_in_place_of_a_buffer_does_not_block(tmp_path: Path) -> None:
    path = gltf(tmp_path, {})
    (tmp_path / "a.bin").unlink()
    os.mkfifo(tmp_path / "a.bin")
    rejected(path, "a.bin: not a regular file")
    (tmp_path / "a.bin").unlink()
    (tmp_path / "a.bin").symlink_to("/dev/zero")
    rejected(path, "a.bin: not a regular file")


@pytest.mark.parametrize("suffix", mesh_file.FORMATS)
def test_a_fifo_or_a_device_in_place_of_a_mesh_does_not_block(tmp_path: Path, suffix: str) -> None:
    os.mkfifo(tmp_path / f"a{suffix}")
    rejected(tmp_path / f"a{suffix}", "not a regular file")
    (tmp_path / f"b{suffix}").symlink_to("/dev/zero")
    rejected(tmp_path / f"b{suffix}", "not a regular file")


@pytest.mark.parametrize("suffix", mesh_file.FORMATS)
def test_a_git_lfs_pointer_is_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"body{suffix}"
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d\nsize 12\n")
    line = rejected(path, "a Git LFS pointer")
    assert "git lfs pull" in line


def sparse(path: Path, head: bytes, size: int) -> Path:
    """A file of ``size`` bytes that begins with ``head`` and takes no room on the disk."""
    with path.open("wb") as stream:
        stream.write(head)
        stream.truncate(size)
    return path


def test_a_huge_stl_is_rejected_by_its_header(tmp_path: Path) -> None:
    faces = 3_800_000
    path = sparse(tmp_path / "a.stl", b"\0" * 80 + struct.pack("<I", faces), 84 + 50 * faces)
    rejected(path, f"{faces} triangles; at most {MAX_FACES} are accepted")
    path = sparse(tmp_path / "b.stl", b"\0" * 80 + struct.pack("<I", 5_800_000), 290_000_084)
    rejected(path, "larger than")


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".ply", ".off", ".dae", ".gltf"])
def test_huge_text_is_rejected_by_its_size(tmp_path: Path, suffix: str) -> None:
    rejected(
        sparse(tmp_path / f"a{suffix}", b"solid\n", 150_000_000), "larger than", "UTF-8", "not JSON"
    )


def test_an_obj_of_very_many_groups_is_read_without_them(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" + "o x\ng y\n" * 60_000)
    assert len(read_mesh(path, Repairs())) == 1


def test_memory_that_a_reader_takes_is_limited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_file, "READ_BYTES", 1_000_000)
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" * 100_000)
    rejected(path, "of memory")
    before = resource.getrlimit(resource.RLIMIT_AS)
    assert before == resource.getrlimit(resource.RLIMIT_AS)


def test_text_of_a_file_behind_a_link_is_not_quoted(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("OFF\nroot:x:0:0\n")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "a.off").symlink_to(secret)
    line = rejected(tmp_path / "a" / "a.off", "cannot be read", "no triangles")
    assert "root" not in line


def test_a_link_to_a_mesh_is_read(tmp_path: Path) -> None:
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "box.obj")
    (tmp_path / "a.obj").symlink_to(tmp_path / "box.obj")
    ((_, mesh, _),) = read_mesh(tmp_path / "a.obj", Repairs())
    assert mesh.volume == pytest.approx(1.0)


def test_materials_without_bound_are_rejected_and_many_groups_are_read_as_one(tmp_path):
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    faces = "f 1 2 3\nf 1 2 4\n"
    path = tmp_path / "a.obj"
    path.write_text(corners + "".join(f"usemtl m{k}\n{faces}" for k in range(5000)))
    with pytest.raises(AssetError, match="5000 materials; at most 4000 are accepted"):
        read_mesh(path, Repairs())
    path.write_text(corners + "".join(f"g g{k}\n{faces}" for k in range(2001)))
    assert len(load_scene(path).geometry) == 1
