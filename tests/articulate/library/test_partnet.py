"""A folder of PartNet-Mobility objects."""

import json
from pathlib import Path

import pytest

from articulate.conversion.convert import read_input
from articulate.errors import AssetError, UsageError
from articulate.formats.config import ConvertConfig
from articulate.library import Library, PartNetLibrary, ProceduralLibrary, open_library
from articulate.library.procedural.categories import write_object

URDF = """<robot name="x"><link name="base"/>
<link name="link_0"><visual><geometry><mesh filename="textured_objs/a.obj"/></geometry></visual>
</link><link name="link_1"><visual><geometry><mesh filename="textured_objs/b.obj"/></geometry>
</visual><visual><geometry><mesh filename="textured_objs/a.obj"/></geometry></visual></link>
<joint name="j0" type="fixed"><parent link="base"/><child link="link_0"/></joint>
<joint name="j1" type="revolute"><parent link="link_0"/><child link="link_1"/>
<axis xyz="0 1 0"/><limit lower="0" upper="1"/></joint></robot>"""
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def folder(tmp_path):
    """Objects 7, 10 and 102; the last one has nothing but its URDF."""
    for name in ("102", "10", "7"):
        own = tmp_path / "set" / name
        (own / "textured_objs").mkdir(parents=True)
        (own / "mobility.urdf").write_text(URDF)
        for mesh in ("a", "b"):
            (own / "textured_objs" / f"{mesh}.obj").write_text(TRIANGLE)
        if name != "102":
            (own / "meta.json").write_text(json.dumps({"model_cat": "Oven"}))
            (own / "semantics.txt").write_text("link_1 hinge rotation_door\nlink_0 heavy\n\nx\n")
            (own / "mobility_v2.json").write_text("[]")
    (tmp_path / "set" / "notes").mkdir()
    return tmp_path / "set"


def test_ids_are_the_folders_in_the_order_of_their_numbers(folder):
    library: Library = PartNetLibrary(folder)
    assert list(library.ids()) == ["7", "10", "102"]
    assert (library.category("7"), library.category("102")) == ("Oven", "unknown")
    assert "non-commercial" in library.licence


def test_without_a_folder_the_procedural_library_is_opened(folder):
    assert isinstance(open_library(), ProceduralLibrary)
    assert open_library(folder).ids() == ("7", "10", "102")


def test_a_written_object_is_read_like_the_original_and_holds_no_truth(folder, tmp_path):
    path = PartNetLibrary(folder).write("7", tmp_path / "out")
    assert path == tmp_path / "out" / "mobility.urdf"
    found = {p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*.*")}
    meshes = {"textured_objs/a.obj", "textured_objs/b.obj"}
    assert found == {"mobility.urdf", "meta.json", "semantics.txt", *meshes}
    reading = read_input(path, ConvertConfig())
    assert [part.name for part in reading.parts] == ["link_0", "link_1"]


def test_links_to_other_places_are_not_followed(folder, tmp_path):
    secret = tmp_path / "secret.txt"
    secret.write_text("mine")
    (folder / "7" / "textured_objs" / "c.obj").symlink_to(secret)
    (folder / "7" / "meta.json").unlink()
    (folder / "7" / "meta.json").symlink_to(secret)
    PartNetLibrary(folder).write("7", tmp_path / "out")
    assert "mine" not in [p.read_text() for p in (tmp_path / "out").rglob("*.*")]


def test_parts_are_named_as_the_data_set_does(folder):
    first, second = PartNetLibrary(folder).parts("7")
    assert (first.link, first.joint_type, first.name) == ("link_0", "static", "link_0")
    assert (second.link, second.joint_type, second.name) == ("link_1", "hinge", "rotation_door")
    assert [path.name for path in second.meshes] == ["b.obj", "a.obj"]


def test_unknown_ids_and_empty_folders_are_answered_in_one_line(folder, tmp_path):
    with pytest.raises(AssetError, match=r"no object '1022' in .*; did you mean 102"):
        PartNetLibrary(folder).write("1022", tmp_path / "x")
    with pytest.raises(AssetError, match=r"no object '\.\./7'"):
        PartNetLibrary(folder).write("../7", tmp_path / "x")
    with pytest.raises(UsageError, match=r"no folder in it holds a mobility\.urdf"):
        PartNetLibrary(tmp_path / "nowhere")
    write_object("box_with_lid", 0, tmp_path / "other" / "box")
    with pytest.raises(UsageError, match="one folder each"):
        PartNetLibrary(tmp_path / "other")


@pytest.mark.dataset
def test_every_object_of_the_data_set_has_a_category_and_parts(data_folder: Path):
    library = PartNetLibrary(data_folder / "assets" / "partnet")
    assert len(library.ids()) > 100
    for object_id in library.ids()[::20]:
        assert library.category(object_id) != "unknown"
        parts = library.parts(object_id)
        assert parts
        assert all(path.is_file() for part in parts for path in part.meshes)
