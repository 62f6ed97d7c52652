"""Rules for toilets, wall plates, lids of bins and boxes; doors in frames."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from tests.articulate.reconstruct.scan.scan_objects import box, carcass, merged, overlap, write

from articulate.reconstruct.scan.lids import open_flaps
from articulate.reconstruct.scan.make_scan import find_parts
from articulate.reconstruct.scan.propose import propose_parts
from articulate.reconstruct.scan.read_scan import ScanHints, read_scan
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.segmentation import Segmentation


def plate(z, length=0.45, width=0.36, thickness=0.02):
    """A board at height ``z`` whose front end is half an ellipse."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 24)
    front = np.c_[0.5 * length * np.cos(angle) + 0.25 * length, 0.5 * width * np.sin(angle)]
    outline = np.vstack([front, [(0.0, width / 2), (0.0, -width / 2)]])
    polygon = trimesh.path.polygons.Polygon(outline)
    board = trimesh.creation.extrude_polygon(polygon, thickness)
    board.apply_translation((0.2, 0.0, z))
    return board


def toilet():
    bowl = plate(0.0, 0.45, 0.34, 0.4)
    tank = box((0, -0.2, 0.35), (0.18, 0.2, 0.8))
    return [bowl, tank], [[plate(0.43)], [plate(0.405)]]


def cylinder(radius, low, high):
    made = trimesh.creation.cylinder(radius, high - low, sections=48)
    made.apply_translation((0, 0, 0.5 * (low + high)))
    return made


def bin_with_lid(*ears):
    """A round bin; ``ears`` are directions in which body and lid have a short block at the rim."""
    body, lid = [cylinder(0.15, 0.0, 0.4)], [cylinder(0.15, 0.401, 0.43)]
    for x, y in ears:
        low, high = np.minimum((0.15 * x, 0.15 * y), (0.17 * x, 0.17 * y)), None
        high = np.maximum((0.15 * x, 0.15 * y), (0.17 * x, 0.17 * y)) + 0.02 * abs(
            np.array([y, x], dtype=float)
        )
        low = low - 0.02 * abs(np.array([y, x], dtype=float))
        body.append(box((*low, 0.36), (*high, 0.4)))
        lid.append(box((*low, 0.401), (*high, 0.43)))
    return body, [lid]


def open_box(*angles_deg):
    """A box of five sheets with one flap at each side; 0 is closed, 90 upright, 180 outside."""
    half, height, length = np.array([0.2, 0.15]), 0.25, 0.12
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half
    points = [(*corner, z) for z in (0.0, height) for corner in corners]
    faces = [(0, 2, 1), (0, 3, 2)]
    flaps = []
    for k, angle in enumerate(angles_deg):
        a, b = k, (k + 1) % 4
        faces += [(a, b, b + 4), (a, b + 4, a + 4)]
        inward = -0.5 * (corners[a] + corners[b]) / np.linalg.norm(0.5 * (corners[a] + corners[b]))
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        for corner in (b, a):
            points.append((*(corners[corner] + length * c * inward), height + length * s))
        n = len(points)
        flaps.append([len(faces), len(faces) + 1])
        faces += [(a + 4, b + 4, n - 2), (a + 4, n - 2, n - 1)]
    label = np.full(len(faces), -1)
    for k, flap in enumerate(flaps):
        label[flap] = k
    n = len(faces)
    mesh = ScanMesh(
        vertices=np.array(points, dtype=float), faces=np.array(faces), rgb=np.full((n, 3), 0.6),
        group=np.zeros(n, dtype=np.int64),
    )  # fmt: skip
    return mesh, label


def wall_plate(*switches):
    return [box((0, -0.04, 0), (0.008, 0.04, 0.12))], [[one] for one in switches]


@pytest.mark.parametrize("quarter", range(4))
def test_lid_and_seat_of_a_toilet_turn_about_the_edge_at_the_tank(quarter, tmp_path):
    mesh, label = merged(*toilet())
    c, s = np.round([np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2)])
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    write(mesh.transformed(turn, 1.0, np.zeros(3)), tmp_path / "scan.glb")
    scan, found = find_parts(read_scan(tmp_path / "scan.glb", ScanHints()), ScanHints())
    assert [part.kind for part in found] == ["lid", "part"]
    assert scan.category == "Toilet"
    for part in found:
        np.testing.assert_allclose(part.axis, (0, -1, 0))
        corners = scan.mesh.triangles[part.faces].reshape(-1, 3)
        np.testing.assert_allclose(part.pivot[0], corners[:, 0].min())
        motion = np.cross(part.axis, corners.mean(axis=0) - part.pivot)
        assert motion[2] > 0.0  # up
    mesh, label = merged(*toilet())
    own = [overlap(mesh, part.faces, label, k) for k, part in enumerate(propose_parts(mesh).parts)]
    assert min(own) > 0.99


def test_a_stool_without_a_tank_has_no_lid():
    (bowl, _), plates = toilet()
    mesh, _ = merged([bowl], plates)
    assert propose_parts(mesh).category != "Toilet"


@pytest.mark.parametrize("ear", [(-1, 0), (1, 0), (0, 1), (0, -1)])
def test_a_lid_with_a_hinge_at_the_rim_turns_about_it(ear):
    mesh, label = merged(*bin_with_lid(ear))
    found = propose_parts(mesh)
    (lid,) = found.parts
    assert (lid.kind, lid.joint, found.category) == ("lid", "revolute", "TrashCan")
    assert overlap(mesh, lid.faces, label, 0) > 0.99
    np.testing.assert_allclose(lid.pivot, (0.15 * ear[0], 0.15 * ear[1], 0.401), atol=1e-3)
    assert np.cross(lid.axis, (0, 0, 0.43) - lid.pivot)[2] > 0.0  # the middle goes up


@pytest.mark.parametrize(
    "angles",
    [
        (45, 45, 45, 45),
        (120, 130, 140, 150),
        (180, 175, 185, 180),
        (215, 60, 225, 70),
        (120, 60, 200, 100),
    ],
)
def test_flaps_of_an_open_box_turn_about_the_rim_that_they_share_with_its_walls(angles):
    mesh, label = open_box(*angles)
    found = propose_parts(mesh)
    assert found.category == "Box"
    assert [part.kind for part in found.parts] == ["flap"] * 4
    for part in found.parts:
        side = int(label[part.faces[0]])
        assert overlap(mesh, part.faces, label, side) > 0.99
        np.testing.assert_allclose(part.pivot[2], 0.25, atol=1e-6)
        np.testing.assert_allclose(part.lower, -np.radians(angles[side]), atol=0.02)
        # At its lower limit, each flap is level inside the rim.
        corners = mesh.triangles[part.faces].reshape(-1, 3)
        turn = Rotation.from_rotvec(part.lower * part.axis)
        closed = turn.apply(corners - part.pivot) + part.pivot
        np.testing.assert_allclose(closed[:, 2], 0.25, atol=0.003)
        assert (np.abs(closed[:, :2]) < np.array([0.2, 0.15]) + 1e-6).all()


def test_a_closed_box_with_a_border_has_no_flaps():
    mesh, _ = open_box(170, 170, 170, 170)
    cover = np.array([(4, 5, 6), (4, 6, 7)])
    faces = np.r_[mesh.faces, cover]
    closed = ScanMesh(
        vertices=mesh.vertices, faces=faces, rgb=np.full((len(faces), 3), 0.6),
        group=np.zeros(len(faces), dtype=np.int64),
    )  # fmt: skip
    assert not open_flaps(Segmentation(closed))
    assert len(open_flaps(Segmentation(mesh))) == 4


def test_an_open_box_without_flaps_has_none():
    mesh, label = open_box(170, 170, 170, 170)
    assert open_flaps(Segmentation(mesh.select(np.flatnonzero(label < 0)))) == []


@pytest.mark.parametrize("seed", range(6))
def test_boxes_with_flaps_at_any_angle_are_read(seed):
    random = np.random.default_rng(seed)
    mesh, label = open_box(*random.uniform(30.0, 230.0, 4))
    sized = mesh.transformed(np.diag(random.uniform(0.6, 1.5, 3)), 1.0, np.zeros(3))
    found = open_flaps(Segmentation(sized))
    assert len(found) == 4
    for flap in found:
        assert max(overlap(sized, flap.faces, label, k) for k in range(4)) > 0.99


def test_the_ears_of_a_pot_are_no_hinge():
    for ears in [(), ((-1, 0), (1, 0))]:
        mesh, _ = merged(*bin_with_lid(*ears))
        (lid,) = propose_parts(mesh).parts
        assert lid.joint == "prismatic"


def test_a_dial_turns_about_the_normal_of_the_plate_and_toggles_about_a_level_axis():
    dial = trimesh.creation.cylinder(0.02, 0.02, sections=48)
    dial.apply_transform(trimesh.geometry.align_vectors((0, 0, 1), (1, 0, 0)))
    dial.apply_translation((0.018, 0.0, 0.06))
    mesh, label = merged(*wall_plate(dial))
    found = propose_parts(mesh)
    assert found.category == "Switch"
    assert [(part.kind, part.joint) for part in found.parts] == [("knob", "continuous")]
    np.testing.assert_allclose(found.parts[0].axis, (1, 0, 0))
    toggles = [box((0.008, y - 0.006, 0.05), (0.02, y + 0.006, 0.07)) for y in (-0.018, 0.018)]
    mesh, label = merged(*wall_plate(*toggles))
    found = propose_parts(mesh)
    assert [(part.kind, part.joint) for part in found.parts] == [("switch", "revolute")] * 2
    np.testing.assert_allclose(found.parts[0].axis, (0, -1, 0))
    own = [max(overlap(mesh, part.faces, label, k) for part in found.parts) for k in (0, 1)]
    assert min(own) > 0.99


def test_a_handle_at_the_edge_of_a_board_is_no_switch():
    mesh, _ = merged(*wall_plate(box((0.008, 0.025, 0.05), (0.03, 0.035, 0.07))))
    assert propose_parts(mesh).category != "Switch"


def test_a_handle_that_ends_on_the_rails_belongs_to_one_framed_door():
    rails = [box((0.5, -0.39, z), (0.53, 0.39, z + 0.1)) for z in (0.03, 0.77)]
    stiles = [box((0.5, y, 0.13), (0.53, y + 0.1, 0.77)) for y in (-0.39, 0.29)]
    pane = box((0.505, -0.29, 0.13), (0.515, 0.29, 0.77))
    bar = box((0.55, 0.33, 0.1), (0.57, 0.35, 0.8))
    posts = [box((0.53, 0.33, z), (0.55, 0.35, z + 0.02)) for z in (0.1, 0.78)]
    mesh, label = merged(carcass(), [[*rails, *stiles, pane, bar, *posts]])
    (door,) = propose_parts(mesh).parts
    assert (door.kind, door.joint) == ("door", "revolute")
    assert overlap(mesh, door.faces, label, 0) > 0.9
    assert door.pivot[1] < -0.3


@pytest.mark.parametrize(("depth", "is_screen"), [(0.1, False), (0.6, True)])
def test_a_slab_above_a_shallow_base_is_no_screen(depth, is_screen):
    base = box((0, -0.4, 0), (depth, 0.4, 0.2))
    slab = box((0, -0.4, 0.201), (0.02, 0.4, 0.8))
    mesh, _ = merged([base], [[slab]])
    found = propose_parts(mesh).parts
    assert ("a thin slab above a flat base" in [p.evidence[0] for p in found]) == is_screen


@pytest.mark.parametrize(("gap", "is_lid"), [(0.005, True), (0.0, False)])
def test_all_that_is_above_a_level_gap_through_a_box_is_its_lid(gap, is_lid):
    def ring(z0, z1):
        walls = [box((x, -0.3, z0), (x + 0.02, 0.3, z1)) for x in (0.0, 0.38)]
        return walls + [box((0.02, y, z0), (0.38, y + 0.02, z1)) for y in (-0.3, 0.28)]

    body = [*ring(0.02, 0.25), box((0, -0.3, 0), (0.4, 0.3, 0.02))]
    lid = [*ring(0.25 + gap, 0.33), box((0, -0.3, 0.33), (0.4, 0.3, 0.35))]
    mesh, label = merged(body, [lid])
    found = propose_parts(mesh).parts
    lids = [part for part in found if overlap(mesh, part.faces, label, 0) > 0.99]
    assert [part.kind for part in lids] == ["lid"] * is_lid
    if is_lid:
        np.testing.assert_allclose(lids[0].pivot, (0.0, 0.0, 0.255), atol=1e-9)


def test_a_door_in_front_of_its_door_frame_is_one_part():
    posts = [box((0.02, y, 0), (0.1, y + 0.05, 2.05)) for y in (-0.45, 0.4)]
    outer, inner = [(-0.45, 0), (-0.45, 2.05), (0.45, 2.05), (0.45, 0)], [(0.4, 0), (0.4, 2.0)]
    outline = [*outer, *inner, (-0.4, 2.0), (-0.4, 0)]
    frame = trimesh.creation.extrude_polygon(trimesh.path.polygons.Polygon(outline), 0.02)
    frame.vertices = frame.vertices[:, [2, 0, 1]]
    leaf = [box((0.05, -0.395, 0.01), (0.09, 0.395, 1.99))]
    knob = [box((0.09, 0.3, 0.95), (0.13, 0.34, 0.99))]
    mesh, label = merged([frame, *posts], [[*leaf, *knob]])
    door, *_ = propose_parts(mesh).parts
    assert door.kind == "door"
    assert overlap(mesh, door.faces, label, 0) > 0.9


def test_tall_doors_in_planes_one_door_apart_slide():
    board = [
        box((0.56, -0.5, 0.05), (0.58, 0.02, 1.9)),
        box((0.581, -0.02, 0.05), (0.601, 0.5, 1.9)),
    ]
    handles = [
        box((0.58, -0.45, 0.9), (0.59, -0.43, 1.1)),
        box((0.601, 0.43, 0.9), (0.611, 0.45, 1.1)),
    ]
    doors = [[one, handle] for one, handle in zip(board, handles, strict=True)]
    mesh, _ = merged(carcass(1.04, 1.95, 0.55), doors)
    found = propose_parts(mesh).parts
    assert [part.joint for part in found] == ["prismatic"] * 2
    assert sorted(float(part.axis[1]) for part in found) == [-1.0, 1.0]
