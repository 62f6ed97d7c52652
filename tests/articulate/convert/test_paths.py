from __future__ import annotations

from pathlib import Path

import pytest

from articulate.convert.paths import resolve
from articulate.errors import AssetError


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    folder = tmp_path / "cabinet" / "urdf"
    folder.mkdir(parents=True)
    (tmp_path / "cabinet" / "meshes").mkdir()
    (tmp_path / "cabinet" / "meshes" / "Drawer.obj").write_text("v 0 0 0\n")
    return folder / "cabinet.urdf"


@pytest.mark.parametrize(
    "reference",
    [
        "package://cabinet/meshes/Drawer.obj",
        "package://CABINET/meshes/drawer.OBJ",
        "model://cabinet/meshes/Drawer.obj",
        "package://elsewhere/meshes/Drawer.obj",
        "../meshes/Drawer.obj",
        "..\\meshes\\Drawer.obj",
        "../meshes/drawer.obj",
        "C:\\users\\me\\cabinet\\meshes\\Drawer.obj",
        "/home/me/meshes/Drawer.obj",
        "Drawer.obj",
        "file://meshes/Drawer.obj",
        "../meshes/%44rawer.obj",
    ],
)
def test_every_way_of_writing_a_path_finds_the_mesh(urdf: Path, reference: str) -> None:
    assert resolve(reference, urdf).name.lower() == "drawer.obj"


def test_an_absolute_path_is_taken_as_it_is(urdf: Path) -> None:
    mesh = urdf.parent.parent / "meshes" / "Drawer.obj"
    assert resolve(str(mesh), urdf) == mesh
    assert resolve(mesh.as_uri(), urdf) == mesh


def test_mesh_dirs_are_looked_in(urdf: Path, tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "x.stl").write_text("solid\n")
    with pytest.raises(AssetError):
        resolve("x.stl", urdf)
    assert resolve("x.stl", urdf, (tmp_path / "far",)).name == "x.stl"


def test_ros_package_path_is_looked_in(
    urdf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ros" / "door" / "meshes").mkdir(parents=True)
    (tmp_path / "ros" / "door" / "meshes" / "leaf.stl").write_text("solid\n")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    assert resolve("package://door/meshes/leaf.stl", urdf).name == "leaf.stl"


def test_an_absent_mesh_is_refused_in_one_line_that_lists_what_was_tried(urdf: Path) -> None:
    with pytest.raises(AssetError) as caught:
        resolve("package://cabinet/meshes/lid.obj", urdf)
    message = str(caught.value)
    assert "\n" not in message
    assert "lid.obj" in message
    assert "meshes" in message
    assert "Put it there" in message
