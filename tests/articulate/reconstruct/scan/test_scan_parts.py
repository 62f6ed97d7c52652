from __future__ import annotations

import numpy as np
import pytest
import trimesh
from tests.articulate.reconstruct.scan.scan_objects import (
    box,
    box_of_boards,
    bucket,
    carcass,
    chest_of_drawers,
    double_doors,
    faucet,
    folded_bucket,
    laptop,
    lined_drawers,
    merged,
    overlap,
    plain_boards,
    room_door,
    safe,
    side_lever_faucet,
    write,
)

from articulate.reconstruct.result import MakeRequest
from articulate.reconstruct.scan.cavity import build_parts
from articulate.reconstruct.scan.cells import components, edges_of, facets
from articulate.reconstruct.scan.make_scan import find_parts, make_scan, scan_parts
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.propose import propose_parts
from articulate.reconstruct.scan.read_scan import ScanHints, read_scan
from articulate.reconstruct.scan.sweep import with_free_joints


def found_in(objects):
    mesh, label = merged(*objects)
    found = propose_parts(mesh)
    overlaps = [
        max(overlap(mesh, part.faces, label, k) for part in found.parts)
        for k in range(label.max() + 1)
    ]
    return mesh, found, overlaps


def test_edges_of_a_box_join_its_faces_and_creases_separate_them():
    mesh, _ = merged([], [[box((0, 0, 0), (1, 2, 3))]])
    edges = edges_of(mesh)
    assert len(edges.pairs) == 18
    assert edges.consistent.all()
    assert not edges.concave[edges.fold_rad > 1.0].any()
    assert components(mesh, edges).count == 1
    cells = facets(mesh, edges)
    assert cells.count == 6
    np.testing.assert_allclose(np.sort(cells.area), [2, 2, 3, 3, 6, 6])


def test_doors_are_hinged_away_from_their_handles():
    _, found, overlaps = found_in(double_doors())
    assert [part.kind for part in found.parts] == ["door", "door"]
    assert min(overlaps) > 0.95
    for part in found.parts:
        assert abs(part.pivot[1]) > 0.35
        assert part.axis[2] * part.pivot[1] > 0  # opens to the front


@pytest.mark.parametrize("objects", [chest_of_drawers, lined_drawers])
def test_a_front_with_a_tray_is_a_drawer(objects):
    _, found, overlaps = found_in(objects())
    assert [part.kind for part in found.parts] == ["drawer"] * 3
    assert min(overlaps) > 0.99
    for part in found.parts:
        np.testing.assert_allclose(part.axis, (1, 0, 0))
        assert 0.2 < part.upper < 0.45


PAIR = ((-0.398, 0.02, -0.002, 0.6), (0.002, 0.02, 0.398, 0.6))
UPPER = ((-0.398, 0.61, -0.002, 0.88), (0.002, 0.61, 0.398, 0.88))


def test_boards_without_handles_in_one_plane_are_doors_hinged_at_the_outer_edges():
    _, found, overlaps = found_in(plain_boards(*PAIR, *UPPER))
    assert [part.kind for part in found.parts] == ["door"] * 4
    assert min(overlaps) > 0.95
    for part in found.parts:
        assert abs(part.pivot[1]) > 0.35
        assert part.confidence < 0.5


def test_a_small_board_beside_a_door_without_a_handle_is_a_control_panel():
    door, controls = (-0.398, 0.02, 0.2, 0.88), (0.202, 0.02, 0.398, 0.88)
    _, found, overlaps = found_in((carcass()[:4], plain_boards(door, controls)[1]))
    assert len(found.parts) == 1
    assert overlaps[0] > 0.95


LEVER = [((0.07, 0.29, 0.95), (0.11, 0.31, 0.97)), ((0.11, 0.18, 0.95), (0.13, 0.31, 0.97))]
PULL = [((0.07, 0.29, 0.8), (0.11, 0.31, 1.1))]
KNOB = [((0.07, 0.27, 0.95), (0.13, 0.33, 1.01))]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_lever_of_a_room_door_turns_down_about_its_end_at_the_edge(side):
    lever = [
        ((x0, *sorted((side * y0, side * y1))[:1], z0), (x1, max(side * y0, side * y1), z1))
        for (x0, y0, z0), (x1, y1, z1) in LEVER
    ]
    _, found, overlaps = found_in(room_door(*lever))
    door, handle = found.parts
    assert (door.kind, handle.kind, handle.joint, handle.on) == ("door", "switch", "revolute", 0)
    assert min(overlaps) > 0.95
    np.testing.assert_allclose(handle.pivot[1:], [side * 0.3, 0.96], atol=0.02)
    free_end = np.array([0.12, side * 0.18, 0.96]) - handle.pivot
    assert np.cross(handle.axis, free_end)[2] < -0.05


def test_a_knob_of_a_room_door_turns_and_a_vertical_bar_is_part_of_the_door():
    _, found, overlaps = found_in(room_door(*KNOB))
    assert [part.kind for part in found.parts] == ["door", "knob"]
    assert min(overlaps) > 0.95
    _, found, _ = found_in(room_door(*PULL))
    assert [part.kind for part in found.parts] == ["door"]


def test_the_edge_of_a_room_door_is_not_its_front(tmp_path):
    mesh, _ = merged(*room_door(*PULL))
    turned_mesh = mesh.transformed(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]), 1.0, np.zeros(3))
    write(turned_mesh, tmp_path / "door.glb")
    _, found = find_parts(read_scan(tmp_path / "door.glb", ScanHints()), ScanHints())
    assert [part.kind for part in found] == ["door"]
    panel = found[0].panel
    assert panel is not None
    np.testing.assert_allclose(panel[2] - panel[0], 0.8, atol=0.1)


@pytest.mark.parametrize("quarter", range(4))
def test_the_side_with_handles_is_the_front_of_open_furniture(quarter, tmp_path):
    fixed, drawers = chest_of_drawers()
    mesh, _ = merged([board for k, board in enumerate(fixed) if k != 0], drawers)  # no back
    c, s = np.round([np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2)])
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    write(mesh.transformed(turn, 1.0, np.zeros(3)), tmp_path / "chest.glb")
    _, found = find_parts(read_scan(tmp_path / "chest.glb", ScanHints()), ScanHints())
    assert [part.kind for part in found] == ["drawer"] * 3
    assert all(len(part.handles) == 1 for part in found)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_equal_panel_beside_a_door_in_another_plane_makes_it_slide(side):
    def board(x, y0, y1):
        low, high = sorted((side * y0, side * y1))
        return box((x, low, 0.02), (x + 0.02, high, 0.88))

    handle = box((0.52, side * 0.3 - 0.01, 0.4), (0.54, side * 0.3 + 0.01, 0.55))
    level = (carcass(), [[board(0.5, 0.0, 0.38), handle], [board(0.5, -0.38, 0.0)]])
    _, found, _ = found_in(level)
    assert {part.joint for part in found.parts} == {"revolute"}
    stepped = (carcass(), [[board(0.5, -0.02, 0.38), handle], [board(0.46, -0.38, 0.02)]])
    _, found, overlaps = found_in(stepped)
    door = next(part for part in found.parts if part.handles)
    assert door.joint == "prismatic"
    np.testing.assert_allclose(door.axis, [0.0, -side, 0.0])
    assert door.upper == pytest.approx(0.8 * 0.4, abs=0.03)
    assert overlaps[0] > 0.9


def test_faces_of_a_chamfered_door_belong_to_it():
    fixed, [[board], _] = room_door()
    board.vertices[board.vertices[:, 0] > 0.05, 1:] -= 0.03 * np.sign(
        board.vertices[board.vertices[:, 0] > 0.05, 1:] - [0, 1]
    )
    _, _, overlaps = found_in((fixed, [[board]]))
    assert overlaps[0] > 0.95


def test_larger_boards_in_the_plane_of_a_drawer_move_too():
    fixed, [drawer] = chest_of_drawers(1)
    doors = plain_boards((-0.38, 0.3, -0.002, 0.88), (0.002, 0.3, 0.38, 0.88))[1]
    _, found, overlaps = found_in((fixed, [drawer, *doors]))
    assert sorted(part.kind for part in found.parts) == ["door", "door", "drawer"]
    assert min(overlaps) > 0.95


@pytest.mark.parametrize("knobs", [(), (-0.2, 0.2)])
def test_a_wide_front_without_a_handle_or_with_two_is_a_drawer(knobs):
    fixed, [[board]] = plain_boards((-0.398, 0.02, 0.398, 0.3))
    knobs = [box((0.52, y - 0.02, 0.15), (0.55, y + 0.02, 0.19)) for y in knobs]
    fixed.append(box((0.0, -0.4, 0.3), (0.5, 0.4, 0.32)))
    _, found, _ = found_in((fixed, [[board, *knobs]]))
    assert [part.kind for part in found.parts] == ["drawer"]


def test_a_low_cabinet_with_a_knob_at_the_edge_of_its_front_has_a_door():
    board = box((0.5, -0.398, 0.01), (0.52, 0.398, 0.29))
    knob = box((0.52, 0.35, 0.14), (0.55, 0.38, 0.17))
    _, found, _ = found_in((carcass(height=0.3), [[board, knob]]))
    assert [part.kind for part in found.parts] == ["door"]
    np.testing.assert_allclose(found.parts[0].axis, [0, 0, -1])


def test_a_rail_behind_the_edges_of_two_doors_is_no_drawer():
    fixed, doors = double_doors()
    rail = box((0.46, -0.38, 0.8), (0.499, 0.38, 0.9))
    for parts in doors:
        parts[0].apply_transform(np.diag([1, 1, 0.95, 1]))  # they end at 0.836
    _, found, _ = found_in(([*fixed, rail], doors))
    assert [part.kind for part in found.parts] == ["door", "door"]


def test_a_wide_board_in_the_middle_turns_about_its_lower_edge():
    fixed, doors = plain_boards((-0.398, 0.38, 0.398, 0.88))
    _, found, _ = found_in((fixed[:4], doors))
    assert [part.kind for part in found.parts] == ["flap"]
    np.testing.assert_allclose(found.parts[0].axis, [0, 1, 0])
    assert found.parts[0].pivot[2] == pytest.approx(0.38, abs=0.01)


def test_a_narrow_board_with_large_dials_is_no_door():
    fixed, [[door], [board]] = plain_boards((-0.398, 0.02, 0.19, 0.6), (0.2, 0.02, 0.398, 0.6))
    handle = box((0.52, 0.14, 0.2), (0.55, 0.16, 0.4))
    dials = [
        trimesh.creation.cylinder(0.03, segment=[(0.52, 0.3, z), (0.55, 0.3, z)])
        for z in (0.2, 0.4)
    ]
    _, found, _ = found_in(([*fixed, board], [[door, handle], *([dial] for dial in dials)]))
    assert sorted(part.kind for part in found.parts) == ["door", "knob", "knob"]


def test_the_caps_of_a_wheel_belong_to_it():
    wheels = []
    for x, y in ((-0.3, -0.4), (-0.3, 0.4), (0.3, -0.4), (0.3, 0.4)):
        tyre = trimesh.creation.annulus(
            0.04, 0.05, segment=[(x, y - 0.02, 0.05), (x, y + 0.02, 0.05)]
        )
        caps = [
            trimesh.creation.cylinder(0.035, segment=[(x, y + e, 0.05), (x, y + e * 1.01, 0.05)])
            for e in (-0.0199, 0.0199)
        ]
        wheels.append([tyre, *caps])
    _, found, overlaps = found_in(([box((-0.5, -0.6, 0.11), (0.5, 0.6, 0.5))], wheels))
    assert [part.kind for part in found.parts].count("wheel") == 4
    assert min(overlaps) > 0.95


def test_the_side_of_a_body_is_no_drawer_and_no_front(tmp_path):
    open_top = carcass()[:4]
    strip = box((-0.02, -0.3, 0.5), (0.0, 0.3, 0.53))  # looks like a handle on the back
    mesh, _ = merged([*open_top, strip], plain_boards(*PAIR)[1])
    scan = read_scan(write(mesh, tmp_path / "cabinet.glb"), ScanHints())
    scan, found = find_parts(scan, ScanHints())
    assert not any("front faces" in note for note in scan.assumptions)
    assert [part.kind for part in found] == ["door", "door"]


def test_a_bail_that_is_folded_down_turns_about_its_ends():
    _, found, overlaps = found_in(folded_bucket())
    assert found.category == "Bucket"
    assert overlaps[0] > 0.9
    assert abs(found.parts[0].axis[1]) == 1.0
    assert abs(found.parts[0].pivot[0]) < 0.06  # the bail reaches to 0.17


def test_a_lever_at_the_side_of_a_faucet_turns_about_its_hub():
    _, found, overlaps = found_in(side_lever_faucet())
    assert found.category == "Faucet"
    assert overlaps[0] > 0.9
    np.testing.assert_allclose(found.parts[0].axis, [0, 1, 0])
    np.testing.assert_allclose(found.parts[0].pivot[[0, 2]], [0, 0.06], atol=0.01)


def test_the_walls_of_a_box_are_no_flaps():
    _, found, overlaps = found_in(box_of_boards())
    assert [part.kind for part in found.parts] == ["lid"]
    assert overlaps[0] > 0.95


@pytest.mark.parametrize(
    ("objects", "kind", "category"), [(laptop, "screen", "Laptop"), (bucket, "handle", "Bucket")]
)
def test_parts_of_other_objects(objects, kind, category):
    _, found, overlaps = found_in(objects())
    assert [part.kind for part in found.parts] == [kind]
    assert found.category == category
    assert overlaps[0] > 0.95
    assert abs(found.parts[0].axis[1]) > 0.99


def test_the_lever_of_a_faucet_turns_on_its_column():
    _, found, overlaps = found_in(faucet())
    assert [part.kind for part in found.parts] == ["switch"]
    assert found.category == "Faucet"
    assert overlaps[0] > 0.95
    np.testing.assert_allclose(found.parts[0].axis, (0, 0, 1))
    np.testing.assert_allclose(found.parts[0].pivot[:2], 0.0, atol=0.01)


def test_a_thick_door_in_a_rim_turns_about_an_upright_edge():
    mesh, found, _ = found_in(safe())
    door = next(part for part in found.parts if part.kind == "door")
    assert abs(door.axis[2]) > 0.99
    assert abs(door.pivot[1]) > 0.2
    assert np.ptp(mesh.triangles[door.faces][..., 0]) > 0.049
    assert np.ptp(mesh.triangles[door.faces][..., 1]) < 0.5


def test_other_numbers_in_the_text_lower_the_confidence():
    mesh, _ = merged(*double_doors())
    right, wrong = (propose_parts(mesh, {"door": n}).parts[0].confidence for n in (2, 3))
    assert right > wrong + 0.2


def test_the_front_is_found_on_another_side(tmp_path):
    mesh, _ = merged(*double_doors())
    turned = mesh.transformed(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), 1.0, np.zeros(3))
    path = write(turned, tmp_path / "cabinet.glb")
    found = scan_parts(read_scan(path, ScanHints()), path, ScanHints())
    assert {joint.part for joint in found.joints} == {"door_1", "door_2"}
    assert any("front faces" in text for text in found.assumptions)


def test_a_hinge_that_collides_is_moved_or_loses_confidence():
    mesh, label = merged(*double_doors())
    door = PartProposal(
        kind="door",
        faces=np.flatnonzero(label == 0),
        joint="prismatic",
        axis=np.array([-1.0, 0, 0]),  # into the carcass, against the back
        pivot=np.zeros(3),
        upper=0.5,
        confidence=0.8,
    )
    assert with_free_joints(mesh, [door])[0].confidence < 0.4


def test_a_solid_front_gets_a_cavity_and_a_drawer_its_tray():
    solid = [box((0, -0.4, 0), (0.5, 0.4, 0.4))]
    mesh, label = merged(solid, [[box((0.5, -0.38, 0.02), (0.52, 0.38, 0.38))]])
    drawer = PartProposal(
        kind="drawer",
        faces=np.flatnonzero(label == 0),
        joint="prismatic",
        axis=np.array([1.0, 0, 0]),
        pivot=np.zeros(3),
        upper=0.3,
        confidence=0.8,
        panel=np.array([-0.38, 0.02, 0.38, 0.38]),
        front=0.52,
        hollow=True,
    )
    built = build_parts(mesh, [drawer], ["drawer_1"], "body")
    assert len(built.notes) == 2
    assert np.ptp(built.parts[0].vertices[:, 0]) > 0.3
    face = built.body.vertices[built.body.faces]
    middle = face.mean(axis=1)
    closing = (
        (middle[:, 0] > 0.49) & (np.abs(middle[:, 1]) < 0.3) & (np.abs(middle[:, 2] - 0.2) < 0.1)
    )
    assert not closing.any()


def test_names_of_the_file_come_first(tmp_path):
    fixed, doors = double_doors()
    scene = trimesh.Scene()
    turn = np.eye(4)
    turn[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    for name, pieces in {"corpus": fixed, "doorLeft": doors[0], "doorRight": doors[1]}.items():
        mesh = trimesh.util.concatenate(pieces)
        scene.add_geometry(mesh.apply_transform(turn), node_name=name, geom_name=name)
    path = tmp_path / "cabinet.glb"
    scene.export(path)
    found = scan_parts(read_scan(path, ScanHints()), path, ScanHints())
    moving = {joint.part for joint in found.joints if joint.kind == "revolute"}
    assert moving == {"doorLeft", "doorRight"}


def moving_parts(folder, **parts):
    """Return the parts that move in a scene of named meshes, and the type of their joints."""
    scene = trimesh.Scene()
    turn = np.eye(4)
    turn[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    for name, pieces in parts.items():
        mesh = trimesh.util.concatenate(pieces)
        scene.add_geometry(mesh.apply_transform(turn), node_name=name, geom_name=name)
    scene.export(folder / "thing.glb")
    hints = ScanHints()
    found = scan_parts(read_scan(folder / "thing.glb", hints), folder / "thing.glb", hints)
    return {joint.part: joint.kind for joint in found.joints if joint.kind != "fixed"}


def test_knobs_of_furniture_are_handles_and_those_of_room_doors_turn(tmp_path):
    door = box((0.5, -0.38, 0.02), (0.52, 0.38, 0.55))
    drawer = [
        box((0.5, -0.38, 0.57), (0.52, 0.38, 0.88)),
        box((0.05, -0.36, 0.6), (0.5, 0.36, 0.61)),
    ]
    knobs = [box((0.52, y, z), (0.54, y + 0.03, z + 0.03)) for y, z in ((0.3, 0.3), (0, 0.7))]
    found = moving_parts(
        tmp_path, corpus=carcass(), door=[door], drawer=drawer, knob=knobs[:1], knob_2=knobs[1:]
    )
    assert found == {"door": "revolute", "drawer": "prismatic"}
    frame, ((leaf,), (knob,)) = room_door(*KNOB)
    found = moving_parts(tmp_path, frame=frame, door=[leaf], knob=[knob])
    assert found == {"door": "revolute", "knob": "continuous"}


@pytest.mark.slow
def test_a_cabinet_is_made_and_passes(tmp_path):
    mesh, _ = merged(*double_doors())
    path = write(mesh, tmp_path / "cabinet.glb")
    request = MakeRequest(out=tmp_path / "asset", cache=tmp_path / "cache")
    result = make_scan(path, request, ScanHints(text="a cabinet with two doors"))
    assert result.verdict == "passed"
    assert [joint.kind for joint in result.joints] == ["revolute", "revolute"]


def test_a_part_that_takes_the_entire_mesh_is_no_part():
    mesh, _ = merged([box((0, -0.4, 0), (0.5, 0.4, 0.4))], [])
    for front in range(4):
        turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        rotation = np.linalg.matrix_power(turn, front)
        found = propose_parts(mesh.transformed(rotation, 1.0, np.zeros(3)))
        moving = sum(mesh.areas[part.faces].sum() for part in found.parts)
        assert moving < 0.95 * mesh.areas.sum()
