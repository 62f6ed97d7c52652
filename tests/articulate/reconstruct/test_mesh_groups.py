"""Names of the parts in scenes with several materials, and with a mesh in several places."""

from __future__ import annotations

import json
import struct

import numpy as np
import trimesh

from articulate.reconstruct.mesh_groups import groups_of


def edit_gltf(content: bytes, change) -> bytes:
    """Return a GLB whose JSON chunk is what ``change`` makes of it."""
    length = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + length])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def scene_of(**boxes):
    scene = trimesh.Scene()
    for k, (name, low) in enumerate(boxes.items()):
        mesh = trimesh.creation.box(bounds=np.array([low, np.add(low, 0.4)]))
        mesh.visual = trimesh.visual.TextureVisuals(
            material=trimesh.visual.material.PBRMaterial(baseColorFactor=[40 * k, 200, 90, 255])
        )
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    return scene


def names_in(path):
    return sorted(name for name, _, _ in groups_of(path))


def test_the_primitives_of_a_mesh_are_one_part(tmp_path):
    def join(document):
        meshes = {mesh["name"]: k for k, mesh in enumerate(document["meshes"])}
        glass = document["meshes"][meshes["glass"]]
        document["meshes"][meshes["door"]]["primitives"] += glass["primitives"]
        node = next(n for n in document["nodes"] if n.get("mesh") == meshes["glass"])
        del node["mesh"]

    content = scene_of(body=(0, 0, 0), door=(1, 0, 0), glass=(2, 0, 0)).export(file_type="glb")
    path = tmp_path / "cabinet.glb"
    path.write_bytes(edit_gltf(content, join))
    assert names_in(path) == ["body", "door", "door"]
    colours: dict[str, set[object]] = {"body": set(), "door": set()}
    for name, _, colour in groups_of(path):
        colours[name].add(colour)
    assert len(colours["door"]) == 2


def test_a_mesh_that_is_placed_twice_is_two_parts(tmp_path):
    scene = scene_of(body=(0, 0, 0), drawer=(1, 0, 0))
    again = np.eye(4)
    again[:3, 3] = (0, 2, 0)
    scene.graph.update(frame_to="lower", matrix=again, geometry="drawer")
    path = tmp_path / "chest.glb"
    scene.export(path)
    assert names_in(path) == ["body", "drawer", "drawer 2"]


def test_the_name_of_the_node_counts_if_that_of_the_mesh_has_no_word_for_a_part(tmp_path):
    def rename(document):
        for k, mesh in enumerate(document["meshes"]):
            mesh["name"] = f"{('Cube', 'Sphere', 'Cube')[k]}.{k:03d}"

    content = scene_of(body=(0, 0, 0), Door_Left=(1, 0, 0), thing=(2, 0, 0))
    path = tmp_path / "cabinet.glb"
    path.write_bytes(edit_gltf(content.export(file_type="glb"), rename))
    assert names_in(path)[-2:] == ["Door_Left", "body"]
    assert names_in(path)[0].startswith("Cube.")


def test_the_materials_of_an_obj_object_are_one_part(tmp_path):
    lines = ["mtllib two.mtl"]
    lines += [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    lines += ["o door_oak", "usemtl oak", "f 1 2 3", "usemtl steel", "f 2 3 4"]
    lines += ["o body", "usemtl oak", "f 5 6 7", "f 6 7 8"]
    (tmp_path / "two.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "two.mtl").write_text("newmtl oak\nKd 1 0 0\nnewmtl steel\nKd 0 1 0\n")
    assert names_in(tmp_path / "two.obj") == ["body", "door_oak", "door_oak"]
