from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from articulate.errors import AssetError
from articulate.formats import textures
from articulate.formats.mesh_file import read_mesh
from articulate.formats.repairs import Repairs
from articulate.formats.textures import find_named, map_file, mean_colour, named_files


def test_colour_is_the_mean_of_the_image(tmp_path: Path) -> None:
    image = Image.new("RGB", (16, 16), (255, 0, 0))
    image.paste((0, 0, 255), (0, 0, 8, 16))
    image.save(tmp_path / "half.png")
    assert mean_colour(tmp_path / "half.png") == pytest.approx((0.5, 0.0, 0.5), abs=0.01)


def test_palette_with_transparency_is_read_without_a_warning(tmp_path: Path) -> None:
    image = Image.new("P", (8, 8), 1)
    image.putpalette([0, 0, 0, 0, 255, 0] + 254 * [0, 0, 0])
    image.save(tmp_path / "p.png", transparency=b"\x00\xff")
    assert mean_colour(tmp_path / "p.png") == pytest.approx((0.0, 1.0, 0.0))


def test_damaged_image_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.png").write_bytes(b"\x89PNG\r\n\x1a\nnothing")
    with pytest.raises(AssetError, match=r"texture bad\.png: cannot be read"):
        mean_colour(tmp_path / "bad.png")


def test_huge_image_is_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.new("RGB", (20, 20)).save(tmp_path / "big.png")
    monkeypatch.setattr(textures, "MAX_PIXELS", 100)
    with pytest.raises(AssetError, match="more than 100 pixels"):
        mean_colour(tmp_path / "big.png")


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("a.png", "a.png"),
        ("my tex.png", "my tex.png"),
        ("-s 2 2 1 a.png", "a.png"),
        ("-s 2 a.png", "a.png"),
        ("-o 0.5 -s 1 1 my tex.png", "my tex.png"),
        ("-clamp on -blendu off -mm 0 1 sub/a.png", "sub/a.png"),
        ("-BM 0.3 -imfchan r -texres 512 a b c.jpg", "a b c.jpg"),
        ("-s 1 1 1 1.png", "1.png"),
        ("-s 2 2 1 2 tables.png", "2 tables.png"),
        ("-unknown a.png", "-unknown a.png"),
        ("-s", "-s"),
    ],
)
def test_options_of_a_map_are_not_part_of_the_file_name(words: str, name: str) -> None:
    assert map_file(words) == name


def textured(folder: Path, line: str) -> Path:
    (folder / "m.mtl").write_text(f"newmtl x\nKd 1 1 1\n{line}\n")
    path = folder / "a.obj"
    path.write_text("mtllib m.mtl\nusemtl x\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    return path


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("map_Kd -s 2 2 1 a.png", "a.png"),
        ("map_Kd my tex.png", "my tex.png"),
        ("map_Kd -o 0 0 my tex.png", "my tex.png"),
        ("map_Kd ../a.png", "../a.png"),
        ("map_Kd sub\\a.png", "sub/a.png"),
        ("map_Kd C:\\tex\\a.png", "a.png"),
        ("map_Kd /home/me/a.png", "a.png"),
    ],
)
def test_texture_gives_its_colour_and_belongs_to_the_files_of_the_mesh(
    tmp_path: Path, line: str, name: str
) -> None:
    folder = tmp_path / "meshes"
    (folder / "sub").mkdir(parents=True)
    Image.new("RGB", (4, 4), (255, 0, 0)).save(folder / name)
    path, repairs = textured(folder, line), Repairs()
    ((_, _, colour),) = read_mesh(path, repairs)
    assert colour == pytest.approx((1.0, 0.0, 0.0, 1.0), abs=0.01)
    assert [file.resolve() for file in named_files(path)] == [
        folder / "m.mtl",
        (folder / name).resolve(),
    ]
    assert not any("plain colour" in message for message in repairs.messages)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "'-s.png' not found"),
        (b"no image", "cannot be read (not an image)"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "Git LFS pointer"),
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "cannot be read (not an image)"),
    ],
)
def test_texture_that_cannot_be_used_is_named(
    tmp_path: Path, content: bytes | None, reason: str
) -> None:
    if content is not None:
        (tmp_path / "-s.png").write_bytes(content)
    repairs = Repairs()
    ((_, _, colour),) = read_mesh(textured(tmp_path, "map_Kd -s.png"), repairs)
    assert colour == pytest.approx((1.0, 1.0, 1.0, 1.0))
    (message,) = repairs.messages
    assert reason in message
    assert "'-s.png'" in message


def test_names_that_no_file_can_have_are_not_found(tmp_path: Path) -> None:
    for name in ("", "a\0b", "n" * 400, "..", "/"):
        found = find_named(tmp_path, name)
        assert found is None or not found.is_file()


def test_images_are_found_in_sibling_folders_and_not_above_them(tmp_path):
    for folder in ("object/meshes", "object/images", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    for name in ("object/images/a.png", "elsewhere/b.png"):
        (tmp_path / name).write_bytes(b"image")
    meshes = tmp_path / "object" / "meshes"
    assert find_named(meshes, "../images/a.png") == meshes / "../images/a.png"
    assert find_named(meshes, "../../elsewhere/b.png") is None
