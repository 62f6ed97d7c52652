from __future__ import annotations

from pathlib import Path

import pytest

from articulate.errors import AssetError
from articulate.formats.mesh_paths import MissingMesh, found_elsewhere, resolve


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
        "package:///cabinet/meshes/Drawer.obj",
        "package://cabinet/cabinet/meshes/Drawer.obj",
        "file://localhost/somewhere/meshes/Drawer.obj",
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
def test_every_notation_of_a_path_finds_the_mesh(urdf: Path, reference: str) -> None:
    assert resolve(reference, urdf).name.lower() == "drawer.obj"


def test_an_absolute_path_is_used_unchanged(urdf: Path) -> None:
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


def test_an_absent_mesh_is_rejected_in_one_line_that_lists_what_was_tried(urdf: Path) -> None:
    with pytest.raises(MissingMesh) as caught:
        resolve("package://cabinet/meshes/lid.obj", urdf)
    message = str(caught.value)
    assert "\n" not in message
    assert "lid.obj" in message
    assert "meshes" in message
    assert "Put it there" in message


def test_a_package_may_have_blanks_in_its_name(tmp_path: Path) -> None:
    folder = tmp_path / "my cabinet"
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes" / "a.obj").write_text("v 0 0 0\n")
    for reference in ("package://my cabinet/meshes/a.obj", "package://my%20cabinet/meshes/a.obj"):
        assert resolve(reference, folder / "x.urdf").name == "a.obj"


def test_a_package_path_may_name_the_package_itself(
    urdf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ros" / "door").mkdir(parents=True)
    (tmp_path / "ros" / "door" / "leaf.stl").write_text("solid\n")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros" / "door"))
    assert resolve("package://door/leaf.stl", urdf).name == "leaf.stl"


@pytest.mark.parametrize(
    "reference",
    ["package://", "package:///", "/", "..", "x" * 5000, "a\0b.obj", "C:", "http://a/b.obj"],
)
def test_a_reference_without_a_file_name_is_rejected(urdf: Path, reference: str) -> None:
    with pytest.raises(AssetError, match="not found"):
        resolve(reference, urdf)


def test_devices_are_no_meshes(urdf: Path) -> None:
    with pytest.raises(AssetError, match="not found"):
        resolve("/dev/zero", urdf)


@pytest.mark.parametrize(
    ("reference", "elsewhere"),
    [
        ("../meshes/Drawer.obj", False),
        ("package://cabinet/meshes/Drawer.obj", False),
        ("package://elsewhere/meshes/Drawer.obj", False),
        ("../meshes/drawer.obj", True),
        ("package://cabinet/meshes/drawer.obj", True),
        ("../../meshes/Drawer.obj", True),
        ("/home/me/meshes/Drawer.obj", True),
    ],
)
def test_meshes_found_elsewhere_are_distinguished(
    urdf: Path, reference: str, elsewhere: bool
) -> None:
    assert found_elsewhere(reference, urdf, resolve(reference, urdf)) is elsewhere
