"""Pictures of an asset, drawn without a screen: closed, with each joint open, see-through."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO

import numpy as np
from PIL import Image

from articulate.asset_page.views import AZIMUTH_OFF_FRONT_DEG, ELEVATION_DEG, front_azimuth_deg
from articulate.assets.asset import Asset, Joint
from articulate.checks.model import ObjectModel
from articulate.checks.triangles import PALETTE
from articulate.errors import AssetError
from articulate.render.canvas import Canvas, Pixels
from articulate.render.view_camera import Viewpoint, fit_viewpoint
from articulate.simulator import mujoco
from articulate.transforms import Array

SIZE = (640, 520)
"""Width and height of a picture [px]."""
THUMBNAIL_SIZE = (208, 169)
"""Width and height of the small picture for a list [px]."""
MOST_OPEN = 12
"""Joints that get a picture of their own; what hundreds of keys do is seen on a few."""
FIELD_OF_VIEW_DEG = 30.0
FLOOR_RGB = (0.87, 0.885, 0.89)
HORIZON_RGB, ZENITH_RGB = (0.95, 0.96, 0.965), (0.80, 0.85, 0.89)
SHOWN, HIDDEN = 2, 5
"""Geom groups that are drawn and not drawn."""
GHOST = 0.16
"""Opacity of the visual geometry where collision shapes are shown."""
SOLID = 0.62
"""Opacity of a collision shape."""
SHADOW_REACH = 2.0
"""How far from the object's middle shadows are drawn, in units of its diagonal."""
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


@dataclass(frozen=True, kw_only=True)
class Picture:
    """One picture and what is to be seen on it."""

    caption: str
    webp: bytes


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """What a page shows of an asset."""

    closed: Picture
    opened: tuple[Picture, ...]
    """One for each joint, :data:`MOST_OPEN` at most."""
    all_open: Picture | None
    """All joints open; None where there is one joint or none."""
    collision: Picture
    """Collision shapes in colours, the visual geometry see-through."""
    thumbnail: bytes
    """WebP of the object partly open, for a list."""

    @property
    def in_order(self) -> tuple[Picture, ...]:
        """All of them as a page shows them."""
        last = () if self.all_open is None else (self.all_open,)
        return (self.closed, *self.opened, *last, self.collision)


def draw_pictures(
    subject: ObjectModel, needs: Mapping[str, tuple[str, ...]] | None = None
) -> Pictures:
    """Draw the pictures of an asset.

    Args:
        subject: The asset and its model.
        needs: Joints that must be open before others move, by joint; they are opened too.

    Raises:
        MissingError: Nothing can be drawn here.
    """
    needs = needs or {}
    with _Studio(subject.asset) as studio:
        joints = [subject.asset.joint(name) for name in subject.free_joints]
        everything = {joint.name: joint.open for joint in joints}
        studio.choose_view([{}, everything])
        opened = tuple(
            Picture(caption=_open_caption(joint, more), webp=studio.picture(q))
            for joint in joints[:MOST_OPEN]
            for more in [needs.get(joint.name, ())]
            for q in [
                {name: everything[name] for name in (joint.name, *more) if name in everything}
            ]
        )
        all_open = None
        if len(joints) > 1:
            all_open = Picture(caption="All joints open", webp=studio.picture(everything))
        partly = {joint.name: joint.closed + 0.5 * joint.span for joint in joints}
        collision = studio.picture(partly, see_through=True)
        shapes = sum(len(subject.collision_geoms(link.name)) for link in subject.asset.links)
        return Pictures(
            closed=Picture(caption="Closed", webp=studio.picture({})),
            opened=opened,
            all_open=all_open,
            collision=Picture(
                caption=f"The {shapes} collision shapes" + (", joints half open" if joints else ""),
                webp=collision,
            ),
            thumbnail=studio.thumbnail(partly),
        )


def _open_caption(joint: Joint, needs: Sequence[str]) -> str:
    if joint.kind == "slide":
        way = f"{1000.0 * abs(joint.span):.0f} mm"
    else:
        way = f"{np.degrees(abs(joint.span)):.0f}°"
    text = f"{joint.name} open by {way}"
    return f"{text}, with {' and '.join(needs)} open" if needs else text


class _Studio:
    """An asset alone on a floor, with light and a camera; use it in a ``with`` block."""

    def __init__(self, asset: Asset) -> None:
        spec = mujoco.MjSpec.from_file(str(asset.mjcf_path))
        self._size = (
            2 * SIZE[0],
            2 * SIZE[1],
        )  # made half as large after, so that edges are smooth
        _set_stage(spec, asset, self._size)
        try:
            self._model = spec.compile()
        except ValueError as error:
            raise AssetError(f"{asset.mjcf_path}: MuJoCo refuses it on a stage: {error}") from None
        self._subject = ObjectModel(asset, self._model)
        self._data = self._subject.data()
        self._touching = np.concatenate(
            [self._subject.collision_geoms(link.name) for link in asset.links]
        )
        self._seen = np.concatenate([self._subject.visual_geoms(link.name) for link in asset.links])
        self._rgba = np.array(self._model.geom_rgba)
        self._materials = np.array(self._model.geom_matid)
        self._canvas = Canvas(self._model, self._size, shadows=True)
        self._view: Viewpoint | None = None

    def __enter__(self) -> _Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self._canvas.close()

    def choose_view(self, positions: Sequence[Mapping[str, float]]) -> None:
        """Look at the front, so that the object is seen whole in all ``positions``."""
        points = []
        for q in positions:
            self._subject.set_joints(self._data, q)
            points.append(self._corners())
        self._view = self._fitted(np.concatenate(points), self._size[0] / self._size[1])

    def picture(self, q: Mapping[str, float], *, see_through: bool = False) -> bytes:
        """The object at positions ``q`` as WebP; joints not named are closed."""
        return _webp(self._frame(q, self._view, see_through=see_through), SIZE)

    def thumbnail(self, q: Mapping[str, float]) -> bytes:
        """The object at positions ``q`` alone in the middle, small."""
        self._subject.set_joints(self._data, q)
        view = self._fitted(self._corners(), self._size[0] / self._size[1])
        return _webp(self._frame(q, view, see_through=False), THUMBNAIL_SIZE)

    def _frame(self, q: Mapping[str, float], view: Viewpoint | None, *, see_through: bool) -> Pixels:
        assert view is not None, "choose_view comes first"
        self._dress(see_through=see_through)
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = view.lookat_w
        camera.distance = view.distance_m
        camera.azimuth, camera.elevation = view.azimuth_deg, view.elevation_deg
        self._subject.set_joints(self._data, q)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        return self._canvas.draw(self._data, camera, (SHOWN,))

    def _dress(self, *, see_through: bool) -> None:
        """Show the visual geometry, or collision shapes in it; the latter where it is all."""
        m = self._model
        m.geom_rgba[:] = self._rgba
        m.geom_matid[:] = self._materials
        only = len(self._seen) == 0
        m.geom_group[self._touching] = SHOWN if see_through or only else HIDDEN
        m.geom_group[self._seen] = SHOWN
        if see_through:
            m.geom_matid[self._seen] = -1
            m.geom_rgba[self._seen] = (0.6, 0.63, 0.66, GHOST)
            for k, geom in enumerate(self._touching):
                m.geom_matid[geom] = -1
                m.geom_rgba[geom] = (*PALETTE[k % len(PALETTE)], SOLID)

    def _corners(self) -> Array:
        """Corners of the boxes around all geoms of the object (P, 3) [m]."""
        m, data = self._model, self._data
        out = []
        for i in (*self._touching, *self._seen):
            corners = m.geom_aabb[i, :3] + m.geom_aabb[i, 3:] * CORNERS
            out.append(corners @ data.geom_xmat[i].reshape(3, 3).T + data.geom_xpos[i])
        return np.concatenate(out)

    def _fitted(self, points_w: Array, aspect: float) -> Viewpoint:
        return fit_viewpoint(
            points_w,
            azimuth_deg=front_azimuth_deg(self._subject.asset) + AZIMUTH_OFF_FRONT_DEG,
            elevation_deg=ELEVATION_DEG,
            fov_deg=FIELD_OF_VIEW_DEG,
            aspect=aspect,
        )


def _set_stage(spec: mujoco.MjSpec, asset: Asset, size: tuple[int, int]) -> None:
    """Give the object a floor, a sky and two lights."""
    low, high = (np.asarray(corner) for corner in asset.bounds_o)
    extent = max(float(np.linalg.norm(high - low)), 1e-3)
    spec.add_texture(
        name="stage_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=ZENITH_RGB,
        rgb2=HORIZON_RGB,
        width=128,
        height=768,
    )
    floor = spec.worldbody.add_geom(name="stage_floor", type=mujoco.mjtGeom.mjGEOM_PLANE)
    floor.size = [0.0, 0.0, 0.05]
    floor.pos = [0.0, 0.0, float(low[2]) - 0.002 * extent]
    floor.rgba = [*FLOOR_RGB, 1.0]
    floor.contype, floor.conaffinity, floor.group = 0, 0, SHOWN
    head = spec.visual.headlight
    head.ambient, head.diffuse, head.specular = [0.40] * 3, [0.22] * 3, [0.0] * 3
    for light in list(spec.lights):
        spec.delete(light)
    ahead = np.radians(front_azimuth_deg(asset))
    for turn, down, strength, casts in ((-0.6, -1.3, 0.42, True), (0.9, -0.9, 0.14, False)):
        light = spec.worldbody.add_light()
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        direction = np.array([np.cos(ahead + turn), np.sin(ahead + turn), down])
        light.dir = direction
        light.pos = (low + high) / 2.0 - 2.0 * extent * direction
        light.ambient, light.diffuse, light.specular = [0.0] * 3, [strength] * 3, [0.1] * 3
        light.castshadow = casts
    spec.visual.rgba.haze = [*HORIZON_RGB, 1.0]
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    spec.visual.global_.fovy = FIELD_OF_VIEW_DEG
    spec.visual.quality.shadowsize = 4096
    spec.visual.map.shadowclip = (
        SHADOW_REACH  # of the extent; further out the floor would be striped
    )
    spec.visual.quality.offsamples = 0
    spec.stat.extent = extent
    spec.stat.center = (low + high) / 2.0
    spec.visual.map.znear = 0.02
    spec.visual.map.zfar = 60.0


def _webp(pixels: Pixels, size: tuple[int, int]) -> bytes:
    image = Image.fromarray(np.ascontiguousarray(pixels)).resize(size, Image.Resampling.BOX)
    out = BytesIO()
    image.save(out, "WEBP", quality=84, method=4)
    return out.getvalue()
