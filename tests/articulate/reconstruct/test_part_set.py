from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from articulate.errors import AssetError
from articulate.library import ProceduralLibrary
from articulate.reconstruct.part_set import library_part_set, read_part_set


def boxes(folder, **at):
    """A mesh file for each part: a box of 0.2 m at a place."""
    folder.mkdir()
    for name, (place, suffix) in at.items():
        mesh = trimesh.creation.box((0.2, 0.2, 0.2))
        mesh.apply_translation(place)
        mesh.export(folder / f"{name}{suffix}")
    return folder


def two(folder, suffix=".obj"):
    return boxes(folder, body=((0, 0, 0.1), suffix), door_2=((0.2, 0, 0.1), suffix))


def test_a_folder_holds_one_part_for_each_mesh_where_it_lies(tmp_path):
    part_set = read_part_set(two(tmp_path / "chest"))
    assert [m.name for m in part_set.meshes] == ["body", "door_2"] == list(part_set.parts)
    np.testing.assert_allclose(part_set.meshes[1].centre, (0.2, 0, 0.1), atol=1e-9)
    assert part_set.labels == {"body": "body", "door_2": "door"}
    assert (part_set.name, part_set.category, part_set.normalised) == ("chest", "unknown", False)


def test_what_parts_are_called_may_stand_in_a_file_beside_them(tmp_path):
    folder = two(tmp_path / "parts")
    (tmp_path / "labels.json").write_text(json.dumps({"door_2": "hinged lid"}))
    assert read_part_set(folder).labels["door_2"] == "lid"  # the joint's word is not told


def test_programs_and_actors_get_the_same_triangles(tmp_path):
    part_set = read_part_set(two(tmp_path / "chest"), front="y")
    for mesh in part_set.meshes:
        own = np.concatenate(
            [np.asarray(p.mesh.vertices) for p in part_set.parts[mesh.name].pieces]
        )
        np.testing.assert_allclose(own, mesh.vertices)


@pytest.mark.parametrize(
    ("front", "there"),
    [("x", (0.2, 0)), ("-x", (-0.2, 0)), ("y", (0, -0.2)), ("-y", (0, 0.2))],
)
def test_the_front_is_turned_to_x(tmp_path, front, there):
    part_set = read_part_set(two(tmp_path / "chest"), front=front)
    np.testing.assert_allclose(part_set.meshes[1].centre, (*there, 0.1), atol=1e-9)


def test_one_glb_holds_parts_by_name_and_is_y_up(tmp_path):
    scene = trimesh.Scene()
    for name, place in (("body", (0, 0.1, 0)), ("lid", (0, 0.3, 0.05))):
        mesh = trimesh.creation.box((0.4, 0.2, 0.3))
        mesh.apply_translation(place)
        scene.add_geometry(mesh, geom_name=name, node_name=name)
    scene.export(tmp_path / "chest.glb")
    part_set = read_part_set(tmp_path / "chest.glb")
    lid = next(m for m in part_set.meshes if m.name == "lid")
    np.testing.assert_allclose(lid.centre, (0.05, 0, 0.3), atol=1e-6)
    np.testing.assert_allclose(np.ptp(lid.bounds, axis=0), (0.3, 0.4, 0.2), atol=1e-6)
    as_it_lies = read_part_set(tmp_path / "chest.glb", up="z")
    lid = next(m for m in as_it_lies.meshes if m.name == "lid")
    np.testing.assert_allclose(lid.centre, (0, 0.3, 0.05), atol=1e-6)


def test_corners_of_two_colours_become_pieces_of_two_colours(tmp_path):
    folder = boxes(tmp_path / "parts", body=((0, 0, 0.1), ".obj"))
    mesh = trimesh.creation.box((0.2, 0.2, 0.2))
    mesh.apply_translation((0.2, 0, 0.1))
    mesh.unmerge_vertices()
    colours = np.tile([200, 0, 0, 255], (len(mesh.vertices), 1))
    colours[mesh.vertices[:, 2] > 0.1] = [0, 200, 0, 255]
    top = np.asarray(mesh.vertices[:, 2]).reshape(-1, 3).min(axis=1) > 0.1
    colours = np.where(np.repeat(top, 3)[:, None], [0, 200, 0, 255], [200, 0, 0, 255])
    mesh.visual.vertex_colors = colours.astype(np.uint8)
    mesh.export(folder / "door.glb")
    part_set = read_part_set(folder)
    kinds = {p.rgba[:3] for p in part_set.parts["door"].pieces}
    assert len(kinds) == 2
    assert sum(len(p.mesh.faces) for p in part_set.parts["door"].pieces) == 12


def test_joints_of_a_urdf_are_not_heeded(tmp_path):
    urdf = ProceduralLibrary().write("cabinet-0003", tmp_path)
    part_set = read_part_set(urdf)
    assert set(part_set.labels.values()) == {"carcass", "drawer"}
    assert not hasattr(part_set, "joints")


@pytest.mark.parametrize("wanted", ["cabinet:3", "cabinet-0003", "cabinet-3"])
def test_a_library_gives_an_object_by_category_and_seed(wanted):
    part_set = library_part_set(wanted)
    assert part_set.category == "StorageFurniture"
    assert part_set.licence == "MIT"
    low = min(m.bounds[0, 2] for m in part_set.meshes)
    assert low == pytest.approx(0.0, abs=1e-9)
    drawer = next(m for m in part_set.meshes if "drawer" in m.name)
    carcass = next(m for m in part_set.meshes if "carcass" in m.name)
    assert drawer.bounds[1, 0] > carcass.bounds[1, 0] - 1e-6  # the front is +x


def test_without_a_seed_the_first_object_is_taken():
    assert library_part_set("box_with_lid").source.endswith("box_with_lid-0000")


def partnet(folder, urdf_text):
    folder.mkdir(parents=True)
    trimesh.creation.box((0.3, 0.3, 0.3)).export(folder / "a.obj")
    (folder / "mobility.urdf").write_text(urdf_text)
    (folder / "meta.json").write_text('{"model_cat": "Box"}')
    (folder / "semantics.txt").write_text("link_0 hinge rotation_lid\nlink_1 static box_body\n")
    return folder


LINK = '<link name="{}"><visual><geometry><mesh filename="a.obj"/></geometry></visual></link>'
TWO_LINKS = (
    '<robot name="r">' + LINK.format("link_1") + LINK.format("link_0") + '<joint name="j" '
    'type="revolute"><parent link="link_1"/><child link="link_0"/><origin xyz="0 0 0.3"/>'
    '<axis xyz="1 0 0"/><limit lower="0" upper="1"/></joint></robot>'
)


def test_a_partnet_folder_gives_parts_by_what_they_are_called(tmp_path):
    part_set = library_part_set(str(partnet(tmp_path / "data" / "100", TWO_LINKS)))
    assert part_set.labels == {"link_1": "box body", "link_0": "lid"}
    assert (part_set.category, part_set.normalised, part_set.name) == ("Box", True, "object_100")
    lid = next(m for m in part_set.meshes if m.name == "link_0")
    np.testing.assert_allclose(lid.centre, (0, 0, 0.45), atol=1e-6)
    folder = tmp_path / "out"
    folder.mkdir()
    part_set.write_origin(folder)
    assert json.loads((folder / "meta.json").read_text())["model_cat"] == "Box"
    assert "non-commercial" in json.loads((folder / "source.json").read_text())["licence"]


def test_parts_that_do_not_belong_together_are_refused(tmp_path, error_line):
    far = boxes(tmp_path / "far", body=((0, 0, 0), ".obj"), door=((9, 0, 0), ".obj"))
    error_line("given_parts(far apart)", lambda: read_part_set(far))
    same = boxes(tmp_path / "same", body=((0, 0, 0), ".obj"), door=((0, 0, 0), ".obj"))
    error_line("given_parts(all about the origin)", lambda: read_part_set(same))
    units = boxes(tmp_path / "units", body=((0, 0, 0), ".obj"))
    trimesh.creation.box((200, 200, 200)).export(units / "door.stl")
    error_line("given_parts(metres and millimetres)", lambda: read_part_set(units))
    one = boxes(tmp_path / "one", body=((0, 0, 0), ".obj"))
    error_line("given_parts(one part)", lambda: read_part_set(one))


def test_what_is_no_parts_is_refused(tmp_path, error_line):
    error_line("given_parts(nowhere)", lambda: read_part_set(tmp_path / "nowhere"))
    (tmp_path / "letter.txt").write_text("Dear Sir")
    error_line("given_parts(letter.txt)", lambda: read_part_set(tmp_path / "letter.txt"))
    (tmp_path / "empty").mkdir()
    error_line("given_parts(empty folder)", lambda: read_part_set(tmp_path / "empty"))
    (tmp_path / "bad.glb").write_text("glTF")
    error_line("given_parts(bad.glb)", lambda: read_part_set(tmp_path / "bad.glb"))


def test_a_name_that_is_too_long_is_refused():
    for read in (lambda: read_part_set(Path("x" * 300)), lambda: library_part_set("x" * 300)):
        with pytest.raises(AssetError, match="too long"):
            read()


def test_a_library_without_candidates_is_refused(tmp_path, error_line):
    error_line("library_parts('cabnet')", lambda: library_part_set("cabnet"))
    error_line("library_parts('cabinet:123456')", lambda: library_part_set("cabinet:123456"))
    (tmp_path / "empty").mkdir()
    error_line("library_parts(empty folder)", lambda: library_part_set(str(tmp_path / "empty")))
    partnet(tmp_path / "data" / "100", TWO_LINKS)
    error_line("library_parts(folder of objects)", lambda: library_part_set(str(tmp_path / "data")))


def test_a_material_beside_a_mesh_is_no_part(tmp_path):
    folder = two(tmp_path / "chest")
    (folder / "door_2.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (folder / "body.jpg").write_bytes(b"no picture")
    (folder / "shelf.obj").mkdir()
    assert [mesh.name for mesh in read_part_set(folder).meshes] == ["body", "door_2"]


def test_a_name_that_no_program_can_say_is_refused_where_it_is_given(tmp_path, error_line):
    scene = trimesh.Scene()
    for name, at in (("body", 0.0), ("d" * 250, 0.2)):
        mesh = trimesh.creation.box((0.2, 0.2, 0.2))
        mesh.apply_translation((at, 0, 0.1))
        scene.add_geometry(mesh, geom_name=name, node_name=name)
    scene.export(tmp_path / "chest.glb")
    error_line("given_parts(a name of 250 letters)", lambda: read_part_set(tmp_path / "chest.glb"))


def test_labels_that_are_nested_too_deeply_are_not_heeded(tmp_path):
    folder = two(tmp_path / "parts")
    (tmp_path / "labels.json").write_text("[" * 100_000)
    assert read_part_set(folder).labels["door_2"] == "door"
