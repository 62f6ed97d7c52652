from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

from articulate.render.camera import Camera, look_at, pinhole
from articulate.render.canvas import open_context
from articulate.render.parts import PartMesh, plain_part
from articulate.render.scene import PartScene, segmentation_image, segmentation_palette
from articulate.simulator import mujoco
from articulate.transforms import axis_angle_to_matrix, pose

QUAD = np.array([[0, 1, 2], [0, 2, 3]])


def wall(name: str, x: float, half: float, rgb=(1.0, 0.0, 0.0)) -> PartMesh:
    """A square across the x axis."""
    corners = [(x, -half, -half), (x, half, -half), (x, half, half), (x, -half, half)]
    return plain_part(name, np.array(corners), QUAD, rgb)


def box(name: str, low, high, rgb=(0.3, 0.6, 0.9)) -> PartMesh:
    low, high = np.asarray(low, float), np.asarray(high, float)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return plain_part(name, low + corners * (high - low), np.array(faces), rgb)


def camera(n: int = 21) -> Camera:
    """It stands at the origin and sees 45 degrees to each side of +x."""
    return pinhole(width_px=n, height_px=n, fovy_rad=np.pi / 2, T_wc=look_at((0, 0, 0), (1, 0, 0)))


def test_a_wall_covers_the_pixels_that_its_size_says_at_its_depth():
    seen = PartScene([wall("a", 2.0, 1.0)]).rasterize(camera(20))
    covered = seen.part_ids == 0
    rows = np.flatnonzero(covered.any(axis=1))
    assert (rows[0], rows[-1]) == (5, 14)  # half of the picture
    assert covered.sum() == 100
    assert np.allclose(seen.depth_m[covered], 2.0)
    assert np.isinf(seen.depth_m[~covered]).all()


def test_a_slanted_face_has_the_depth_of_its_plane():
    part = plain_part("a", np.array([[1, 2, -2], [3, -2, -2], [3, -2, 2], [1, 2, 2.0]]), QUAD)
    view = camera(41)
    seen = PartScene([part]).rasterize(view)
    v, u = np.nonzero(seen.part_ids == 0)
    points = view.unproject(np.stack([u, v], axis=-1), seen.depth_m[v, u])
    assert len(v) > 300
    assert np.allclose(points[:, 0], 2.0 - 0.5 * points[:, 1], atol=1e-5)


def test_the_nearer_part_hides_the_farther_whatever_their_order():
    near, far = wall("near", 1.0, 0.3), wall("far", 2.0, 1.5)
    one = PartScene([near, far]).rasterize(camera())
    other = PartScene([far, near]).rasterize(camera())
    assert one.part_ids[10, 10] == 0
    assert one.part_ids[4, 4] == 1
    assert np.array_equal(one.depth_m, other.depth_m)


def test_neighbouring_faces_leave_no_crack():
    rng = np.random.default_rng(0)
    inner = rng.uniform(-0.9, 0.9, (60, 2))
    corners = np.concatenate([[[-1, -1], [1, -1], [1, 1], [-1, 1]], inner])
    faces = Delaunay(corners).simplices
    part = plain_part("a", np.column_stack([np.full(len(corners), 1.5), corners]), faces)
    view = pinhole(width_px=401, height_px=401, fovy_rad=1.0, T_wc=look_at((0, 0, 0), (1, 0, 0)))
    assert (PartScene([part]).rasterize(view).part_ids == 0).all()


def test_a_floor_that_reaches_behind_the_camera_is_cut_not_lost():
    floor = plain_part(
        "floor", np.array([[-5, -50, -1], [50, -50, -1], [50, 50, -1], [-5, 50, -1.0]]), QUAD
    )
    seen = PartScene([floor]).rasterize(camera(40))
    assert (seen.part_ids[20 + 2 :] == 0).all()
    assert (seen.part_ids[:20] == -1).all()
    assert seen.depth_m[39, 20] == pytest.approx(1.0 / np.tan(np.arctan(19.5 / 20)), rel=1e-5)


def test_poses_move_parts_in_the_scene():
    scene = PartScene([wall("a", 2.0, 0.5), wall("b", 3.0, 0.2)])
    poses = np.stack([pose([1.0, 0.0, 0.0]), np.eye(4)])
    assert scene.rasterize(camera(), poses).depth_m[10, 10] == pytest.approx(3.0)


def test_a_part_drawn_onto_the_rest_is_as_if_all_were_drawn_at_once():
    parts = [box("a", (2, -1, -1), (3, 1, 1)), box("b", (1.5, -0.4, -0.3), (2.2, 0.5, 0.4))]
    scene = PartScene(parts)
    turn = pose([0.1, 0.2, 0.0], axis_angle_to_matrix([0.0, 0.0, 1.0], 0.2))
    poses = np.stack([np.eye(4), turn])
    rest = scene.rasterize(camera(61), only=[0])
    before = rest.part_ids.copy()
    seen = scene.rasterize(camera(61), poses, only=[1], onto=rest)
    whole = scene.rasterize(camera(61), poses)
    assert np.array_equal(seen.part_ids, whole.part_ids)
    assert np.array_equal(seen.inverse_depth, whole.inverse_depth)
    assert np.array_equal(rest.part_ids, before)


def test_each_part_has_a_colour_of_its_own_on_white():
    colours = segmentation_palette(12)
    assert len(np.unique(colours, axis=0)) == 12
    scene = PartScene([wall("near", 1.0, 0.3), wall("far", 2.0, 1.5)])
    picture = segmentation_image(scene.rasterize(camera()), 2)
    assert picture[10, 10].tolist() == segmentation_palette(2)[0].tolist()
    assert picture[4, 4].tolist() == segmentation_palette(2)[1].tolist()
    assert picture[0, 0].tolist() == [255, 255, 255]


def test_a_face_shows_its_albedo_under_full_light_and_edges_are_smooth():
    scene = PartScene([wall("a", 2.0, 1.1, (0.5, 0.25, 1.0))])
    picture = scene.render_image(camera())
    middle = picture[10, 10].astype(float)
    assert middle[0] / middle[2] == pytest.approx(0.5, abs=0.02)
    assert middle[1] / middle[2] == pytest.approx(0.25, abs=0.02)
    assert picture[0, 0].tolist() == [255, 255, 255]
    border = picture[10, 4].astype(float)  # half wall, half nothing
    assert middle[0] < border[0] < 255


def test_a_texture_is_read_where_its_coordinates_say():
    texture = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], dtype=np.uint8)
    plain = wall("a", 2.0, 1.9)
    corner_uv = np.array([(1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (1.0, 1.0)]) * 0.998 + 0.001
    part = PartMesh(
        name="a",
        vertices=plain.vertices,
        faces=plain.faces,
        rgb=np.ones_like(plain.rgb),
        uv=corner_uv[plain.faces],
        texture=texture,
    )
    picture = PartScene([part]).render_image(camera(), samples=1).astype(int)
    # +y is left in the picture, and u = 0 there; v = 1 is above.
    for (row, column), channel in (
        ((4, 4), [0]),
        ((4, 16), [1]),
        ((16, 4), [2]),
        ((16, 16), [0, 1]),
    ):
        dark = [k for k in range(3) if k not in channel]
        assert picture[row, column, channel].min() > 100
        assert picture[row, column, dark].max() == 0


def test_a_scene_without_parts_is_refused(error_line):
    error_line("PartScene([])", lambda: PartScene([]))


def test_a_face_that_names_no_corner_is_refused(error_line):
    error_line(
        'plain_part("door", 3 corners, [[0, 1, 3]])',
        lambda: plain_part("door", np.zeros((3, 3)), np.array([[0, 1, 3]])),
    )


def opengl_depth(model, data, size: tuple[int, int]) -> np.ndarray:
    """Depth (H, W) that MuJoCo's camera sees, from OpenGL's buffer."""
    gl, context = open_context(model, size)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    scene, camera = mujoco.MjvScene(model, maxgeom=10), mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    every = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, every, scene)
    area = mujoco.MjrRect(0, 0, *size)
    scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = True  # one sample a pixel
    mujoco.mjr_render(area, scene, context)
    context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR  # the finer of the two
    raw = np.zeros((size[1], size[0]), dtype=np.float32)
    mujoco.mjr_readPixels(None, raw, area, context)
    context.free()
    gl.free()
    near, far = model.vis.map.znear, model.vis.map.zfar  # the extent is 1
    return np.asarray(far * near / (raw[::-1].astype(float) * (far - near) + near))


@pytest.mark.render
def test_mujoco_sees_the_same_depth():
    """An independent renderer: OpenGL, through MuJoCo."""
    low, high = np.array([-0.4, -0.3, 0.0]), np.array([0.3, 0.5, 0.7])
    view = pinhole(
        width_px=160, height_px=120, fovy_rad=0.8, T_wc=look_at((1.6, 1.1, 1.2), (0, 0, 0.3))
    )
    mine = PartScene([box("a", low, high)]).rasterize(view).depth_m
    R_wc = view.T_wc[:3, :3]
    size = " ".join(map(str, 0.5 * (high - low)))
    pos = " ".join(map(str, 0.5 * (high + low)))
    axes = " ".join(map(str, [*R_wc[:, 0], *-R_wc[:, 1]]))
    eye = " ".join(map(str, view.eye_w))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><visual><map znear="0.1" zfar="10"/></visual><statistic extent="1"/>
        <worldbody><geom type="box" size="{size}" pos="{pos}"/>
        <camera name="c" pos="{eye}" xyaxes="{axes}" fovy="{np.degrees(0.8)}"/>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    theirs = opengl_depth(model, data, (160, 120))
    both = np.isfinite(mine) & (theirs < 5.0)
    assert (np.isfinite(mine) != (theirs < 5.0)).mean() < 0.005
    assert both.mean() > 0.1
    assert np.median(np.abs(mine[both] - theirs[both])) < 1e-3
