from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from articulate.errors import AssetError
from articulate.formats import mesh_file
from articulate.formats.mesh_file import MAX_GROUPS, read_mesh, read_msh
from articulate.formats.repairs import Repairs
from articulate.formats.textures import named_files

RED = (0.8, 0.1, 0.1, 1.0)


def wedge() -> trimesh.Trimesh:
    """A body without any symmetry."""
    return trimesh.convex.convex_hull(
        [[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0.3, 0.2, 0], [0, 0.05, 0.1]]
    )


def read(path: Path) -> tuple[list, str]:
    repairs = Repairs()
    return read_mesh(path, repairs), "\n".join(repairs.messages)


@pytest.mark.parametrize(
    "name", ["a.obj", "a.stl", "a.STL", "a.dae", "a.glb", "a.gltf", "a.ply", "a.off"]
)
def test_every_format_gives_the_same_triangles(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    mesh = wedge()
    if path.suffix == ".gltf":
        for part, content in trimesh.Scene(mesh).export(file_type="gltf").items():
            (tmp_path / ("a.gltf" if part == "model.gltf" else part)).write_bytes(content)
    else:
        mesh.export(path, file_type=path.suffix[1:].lower())
    groups, _ = read(path)
    assert len(groups) == 1
    found = groups[0][1]
    assert (len(found.vertices), len(found.faces)) == (5, len(mesh.faces))
    np.testing.assert_allclose(found.volume, mesh.volume, rtol=1e-5)
    np.testing.assert_allclose(found.bounds, mesh.bounds, atol=1e-6)


def test_a_text_stl_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    path.write_text(trimesh.exchange.stl.export_stl_ascii(wedge()))
    groups, _ = read(path)
    np.testing.assert_allclose(groups[0][1].volume, wedge().volume, rtol=1e-5)


def test_an_stl_of_more_triangles_than_mujoco_takes_is_read(tmp_path: Path) -> None:
    """It is written as OBJ, for which MuJoCo knows no such bound."""
    n = 320
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    height = 0.01 * np.sin(x) * np.cos(y)
    corners = np.stack([x, y, height], axis=-1)
    a, b, c, d = corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3)
    assert len(triangles) > 200_000
    record = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = triangles
    path = tmp_path / "a.stl"
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(triangles)) + record.tobytes())
    groups, _ = read(path)
    assert len(groups[0][1].faces) == len(triangles)


@pytest.mark.parametrize("word", ["o", "g"])
def test_groups_and_materials_of_an_obj_stay_apart_with_names_and_colours(
    tmp_path: Path, word: str
) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\nnewmtl blue\nKd 0.1 0.1 0.8\n")
    text = "mtllib a.mtl\n"
    for k, (name, colour) in enumerate((("panel", "red"), ("handle-3", "blue"))):
        text += f"{word} {name}\nusemtl {colour}\n"
        text += "".join(
            f"v {k + x} {y} {z}\n" for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
        )
        base = 4 * k
        for face in ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4)):
            text += "f " + " ".join(str(base + v) for v in face) + "\n"
    (tmp_path / "a.obj").write_text(text)
    groups, _ = read(tmp_path / "a.obj")
    panel, handle = sorted(groups, key=lambda group: "handle" in group[0])
    assert "panel" in panel[0]
    assert "handle-3" in handle[0]
    assert (panel[1].bounds[0, 0], handle[1].bounds[0, 0]) == (0.0, 1.0)
    np.testing.assert_allclose(panel[2], RED, atol=0.01)
    np.testing.assert_allclose(handle[2], (0.1, 0.1, 0.8, 1.0), atol=0.01)


def test_an_obj_of_too_many_groups_is_read_as_one(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    text += "".join(f"v {k} 0 1\ng g{k}\nf 1 2 {4 + k}\n" for k in range(MAX_GROUPS + 1))
    (tmp_path / "a.obj").write_text(text)
    groups, _ = read(tmp_path / "a.obj")
    assert [len(mesh.faces) for _, mesh, _ in groups] == [MAX_GROUPS + 1]


def textured(folder: Path, image: str = "wood.png") -> Path:
    (folder / "a.mtl").write_text(f"newmtl wood\nKd 1 1 1\nmap_Kd {image}\n")
    (folder / "a.obj").write_text(
        "mtllib a.mtl\nusemtl wood\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
        "f 1/1 2/2 3/3\n"
    )
    return folder / "a.obj"


def test_a_texture_gives_its_mean_colour(tmp_path: Path) -> None:
    Image.new("RGB", (16, 16), (200, 100, 50)).save(tmp_path / "wood.png")
    groups, repairs = read(textured(tmp_path))
    np.testing.assert_allclose(groups[0][2], [200 / 255, 100 / 255, 50 / 255, 1.0], atol=0.01)
    assert "textures were replaced by the mean colour" in repairs


@pytest.mark.parametrize("content", [None, b"not a image", b"\x89PNG\r\n\x1a\n\0\0\0"])
def test_a_texture_that_cannot_be_read_costs_only_the_colour(
    tmp_path: Path, content: bytes | None
) -> None:
    if content is not None:
        (tmp_path / "wood.png").write_bytes(content)
    groups, _ = read(textured(tmp_path))
    assert len(groups[0][1].faces) == 1


def test_colours_of_corners_give_their_mean(tmp_path: Path) -> None:
    mesh = wedge()
    mesh.visual.vertex_colors = [204, 26, 26, 255]
    mesh.export(tmp_path / "a.ply")
    groups, _ = read(tmp_path / "a.ply")
    np.testing.assert_allclose(groups[0][2], RED, atol=0.01)


def test_collada_is_read_in_its_unit_and_its_axis_is_noted(tmp_path: Path) -> None:
    wedge().export(tmp_path / "a.dae")
    text = (tmp_path / "a.dae").read_text()
    start, end = text.index("<asset"), text.index("</asset>")
    asset = (
        "<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>"
        '<unit name="inch" meter="0.0254"/><up_axis>Y_UP</up_axis>'
    )
    (tmp_path / "a.dae").write_text(text[:start] + asset + text[end:])
    groups, repairs = read(tmp_path / "a.dae")
    np.testing.assert_allclose(groups[0][1].bounds, 0.0254 * wedge().bounds, atol=1e-7)
    assert "units of 0.0254 m" in repairs
    assert "declares Y_UP" in repairs


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_collada_with_entities_is_rejected(tmp_path: Path, encoding: str) -> None:
    wedge().export(tmp_path / "a.dae")
    text = (tmp_path / "a.dae").read_text()
    text = text.replace("<COLLADA", '<!DOCTYPE x [<!ENTITY a "b">]><COLLADA', 1)
    text = text.replace("utf-8", encoding, 1).replace("UTF-8", encoding, 1)
    (tmp_path / "a.dae").write_bytes(text.encode(encoding))
    with pytest.raises(AssetError, match="has a DOCTYPE or entities"):
        read(tmp_path / "a.dae")


def test_doubled_and_empty_triangles_and_doubled_corners_go(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nv 2 0 0\nf 1 2 3\nf 3 2 4\nf 1 2 5\nf 1 1 2\n"
    )
    groups, _ = read(tmp_path / "a.obj")
    assert (len(groups[0][1].vertices), len(groups[0][1].faces)) == (3, 1)


def test_the_back_of_a_sheet_in_another_material_is_left_out_and_noted(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nusemtl a\nf 1 2 3\nf 2 4 3\n"
        "usemtl b\nf 1 3 2\nf 2 3 4\n"
    )
    groups, repairs = read(tmp_path / "a.obj")
    assert len(groups) == 1
    assert "the same triangles in another material" in repairs


def test_corners_at_infinity_take_their_triangles_with_them(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nv 1e30 0 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n"
    )
    groups, repairs = read(tmp_path / "a.obj")
    assert len(groups[0][1].faces) == 1
    assert "corners at infinity left out" in repairs


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.fbx", b"", "format not known"),
        ("a.obj", b"v 0 0 0\nf 1 2 9\n", "cannot be read|corner that does not exist|no triangles"),
        ("a.stl", b"\0" * 84, "no triangles|cannot be read"),
        ("a.stl", b"\0" * 80 + b"\xff\xff\xff\x7f", "cannot be read|no triangles"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 999999999999\n", "cannot be read"),
        ("a.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff", "cannot be read"),
        ("a.dae", b"PK\x03\x04", "an archive"),
        ("a.dae", b"<COLLADA/>", "cannot be read|no triangles"),
        ("a.msh", b"\0" * 20, "cannot be read"),
    ],
)
def test_no_mesh_is_rejected_in_one_line(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(AssetError, match=words) as caught:
        read(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_corners_of_two_coordinates_are_rejected_in_one_line(tmp_path: Path) -> None:
    """A cut-off OBJ; found by mutation."""
    path = tmp_path / "flat.obj"
    path.write_text("v 0 0\nv 1 0\nv 0 1\nv 1 1\nf 1 2 3\nf 2 4 3\n")
    with pytest.raises(AssetError, match=r"^mesh flat\.obj: "):
        read(path)


def test_files_that_a_mesh_names_are_those_that_exist(tmp_path):
    (tmp_path / "pic.png").write_bytes(b"1")
    (tmp_path / "a.bin").write_bytes(b"2")
    scene = tmp_path / "a.gltf"
    scene.write_text('{"buffers": [{"uri": "a.bin"}, {"uri": "absent.bin"}, {"uri": "data:x"}]}')
    assert named_files(scene) == [tmp_path / "a.bin"]
    collada = tmp_path / "a.dae"
    names = ("pic.png", "x\0y", "n" * 400, "pic.png")
    collada.write_text("".join(f"<init_from> {name} </init_from>" for name in names))
    assert named_files(collada) == [tmp_path / "pic.png"]
    ply = tmp_path / "a.ply"
    ply.write_text("pic.png")
    assert named_files(ply) == []


def test_instances_are_counted_before_any_is_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = trimesh.Scene()
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    for k in range(50):
        scene.add_geometry(
            box, geom_name="box", transform=trimesh.transformations.translation_matrix((k, 0, 0))
        )
    path = tmp_path / "many.glb"
    scene.export(path)
    groups, _ = read(path)
    assert len(groups) == 50

    def copied(*_: object, **__: object) -> None:
        raise AssertionError("a mesh was copied")

    monkeypatch.setattr(mesh_file, "MAX_FACES", 12 * 50 - 1)
    monkeypatch.setattr(trimesh.Trimesh, "copy", copied)
    with pytest.raises(AssetError, match=r"many\.glb: 600 triangles; at most 599 are accepted"):
        read(path)


CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def msh(faces: list[tuple[int, int, int]], *, normals: int = 0, coordinates: int = 0) -> bytes:
    """The tetrahedron with so many unused normals and texture coordinates before its faces."""
    return (
        struct.pack("<4i", len(CORNERS), normals, coordinates, len(faces))
        + np.array(CORNERS, "<f4").tobytes()
        + np.full(3 * normals + 2 * coordinates, 7.0, "<f4").tobytes()
        + np.array(faces, "<i4").tobytes()
    )


@pytest.mark.parametrize(("normals", "coordinates"), [(0, 0), (4, 0), (4, 4)])
def test_tetrahedron_has_its_volume(tmp_path: Path, normals: int, coordinates: int) -> None:
    path = tmp_path / "a.msh"
    path.write_bytes(msh(FACES, normals=normals, coordinates=coordinates))
    assert read_msh(path.read_bytes()).volume == pytest.approx(1.0 / 6.0)


def test_vertices_without_faces_are_those_of_a_hull(tmp_path: Path) -> None:
    path = tmp_path / "a.msh"
    path.write_bytes(msh([]))
    assert read_msh(path.read_bytes()).volume == pytest.approx(1.0 / 6.0)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"abc", "too short"),
        (msh(FACES)[:-1], "the header gives"),
        (struct.pack("<4i", -1, 0, 0, 1) + bytes(0), "the header gives"),
        (struct.pack("<4i", 2_000_000_000, 0, 0, 0), "the header gives"),
        (msh([(0, 1, 4)]), "a vertex that does not exist"),
        (msh([(0, 1, -1)]), "a vertex that does not exist"),
    ],
)
def test_counts_that_do_not_fit_are_rejected(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "a.msh"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=reason):
        read_msh(path.read_bytes())
