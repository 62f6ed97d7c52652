"""Render images of an asset without a screen: closed, each joint open, collision shapes."""

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
from articulate.errors import AssetError, shorten
from articulate.render.canvas import Canvas, Pixels
from articulate.render.scene_style import add_sky
from articulate.render.view_camera import Viewpoint, fit_viewpoint, geom_corners
from articulate.simulator import mujoco
from articulate.transforms import Array

SIZE = (640, 520)
"""Width and height of an image [px]."""
THUMBNAIL_SIZE = (208, 169)
"""Width and height of the small image for a list [px]."""
MAX_OPEN = 12
"""Largest number of joints with a separate image."""
FIELD_OF_VIEW_DEG = 30.0
FLOOR_RGB = (0.87, 0.885, 0.89)
HORIZON_RGB, ZENITH_RGB = (0.95, 0.96, 0.965), (0.80, 0.85, 0.89)
VISIBLE, HIDDEN = 2, 5
"""Geom groups that are rendered and not rendered."""
GHOST = 0.16
"""Opacity of the visual geometry in the image of collision shapes."""
SOLID = 0.62
"""Opacity of a collision shape."""
SHADOW_REACH = 2.0
"""Distance from the object's centre up to which shadows are rendered, in its diagonals."""


@dataclass(frozen=True, kw_only=True)
class AssetImage:
    """One image and its caption."""

    caption: str
    webp: bytes


@dataclass(frozen=True, kw_only=True)
class AssetImages:
    """Images of an asset for its page."""

    closed: AssetImage
    opened: tuple[AssetImage, ...]
    """One for each joint, at most :data:`MAX_OPEN`."""
    all_open: AssetImage | None
    """All joints open; None if there are fewer than two joints."""
    collision: AssetImage
    """Collision shapes in colours, with transparent visual geometry."""
    thumbnail: bytes
    """WebP of the object half open, for a list."""

    @property
    def in_order(self) -> tuple[AssetImage, ...]:
        """All images in the order of the page."""
        last = () if self.all_open is None else (self.all_open,)
        return (self.closed, *self.opened, *last, self.collision)


def render_images(
    subject: ObjectModel, needs: Mapping[str, tuple[str, ...]] | None = None
) -> AssetImages:
    """Render the images of an asset, each framed for its own pose.

    Args:
        subject: Asset and its model.
        needs: Joints that must be open before others move, by joint; they are opened too.

    Raises:
        MissingError: There is no OpenGL driver.
    """
    needs = needs or {}
    with _Studio(subject.asset) as studio:
        joints = [subject.asset.joint(name) for name in subject.free_joints]
        everything = {joint.name: joint.open for joint in joints}
        opened = tuple(
            AssetImage(caption=_open_caption(joint, more), webp=studio.image(q))
            for joint in joints[:MAX_OPEN]
            for more in [needs.get(joint.name, ())]
            for q in [
                {name: everything[name] for name in (joint.name, *more) if name in everything}
            ]
        )
        all_open = None
        if len(joints) > 1:
            all_open = AssetImage(caption="All joints open", webp=studio.image(everything))
        partly = {joint.name: joint.closed + 0.5 * joint.span for joint in joints}
        collision = studio.image(partly, see_through=True)
        shapes = sum(len(subject.collision_geoms(link.name)) for link in subject.asset.links)
        return AssetImages(
            closed=AssetImage(caption="Closed", webp=studio.image({})),
            opened=opened,
            all_open=all_open,
            collision=AssetImage(
                caption=f"The {shapes} collision shapes" + (", joints half open" if joints else ""),
                webp=collision,
            ),
            thumbnail=studio.image(partly, size=THUMBNAIL_SIZE),
        )


def _open_caption(joint: Joint, needs: Sequence[str]) -> str:
    if joint.kind == "slide":
        travel = f"{1000.0 * abs(joint.span):.0f} mm"
    else:
        travel = f"{np.degrees(abs(joint.span)):.0f}°"
    text = f"{joint.name} open by {travel}"
    return f"{text}, with {' and '.join(needs)} open" if needs else text


class _Studio:
    """Scene with an asset, a floor, lights and a camera; use it in a ``with`` block."""

    def __init__(self, asset: Asset) -> None:
        spec = mujoco.MjSpec.from_file(str(asset.mjcf_path))
        # Rendered at twice the size and reduced, so that edges are smooth.
        self._size = (2 * SIZE[0], 2 * SIZE[1])
        _set_stage(spec, asset, self._size)
        try:
            self._model = spec.compile()
        except ValueError as error:
            raise AssetError(f"{asset.mjcf_path}: MuJoCo rejects it: {shorten(error)}") from None
        self._subject = ObjectModel(asset, self._model)
        self._data = self._subject.data()
        self._colliding = np.concatenate(
            [self._subject.collision_geoms(link.name) for link in asset.links]
        )
        self._visible = np.concatenate(
            [self._subject.visual_geoms(link.name) for link in asset.links]
        )
        self._rgba = np.array(self._model.geom_rgba)
        self._materials = np.array(self._model.geom_matid)
        self._canvas = Canvas(self._model, self._size, shadows=True)

    def __enter__(self) -> _Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self._canvas.close()

    def image(
        self,
        q: Mapping[str, float],
        *,
        see_through: bool = False,
        size: tuple[int, int] = SIZE,
    ) -> bytes:
        """Render the object at positions ``q`` [m or rad] as WebP of ``size`` [px].

        The object fills the image in this pose. Joints that are not named are closed.
        """
        self._set_appearance(see_through=see_through)
        self._subject.set_joints(self._data, q)
        view = self._fitted(self._corners(), self._size[0] / self._size[1])
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        return _webp(self._canvas.render(self._data, view.camera(), (VISIBLE,)), size)

    def _set_appearance(self, *, see_through: bool) -> None:
        """Show the visual geometry, with collision shapes inside if transparent or empty."""
        m = self._model
        m.geom_rgba[:] = self._rgba
        m.geom_matid[:] = self._materials
        only = len(self._visible) == 0
        m.geom_group[self._colliding] = VISIBLE if see_through or only else HIDDEN
        m.geom_group[self._visible] = VISIBLE
        if see_through:
            m.geom_matid[self._visible] = -1
            m.geom_rgba[self._visible] = (0.6, 0.63, 0.66, GHOST)
            for k, geom in enumerate(self._colliding):
                m.geom_matid[geom] = -1
                m.geom_rgba[geom] = (*PALETTE[k % len(PALETTE)], SOLID)

    def _corners(self) -> Array:
        """Return the corners (P, 3) of the bounding boxes of all geoms of the object [m]."""
        geoms = (*self._colliding, *self._visible)
        return geom_corners(self._model, self._data, geoms)

    def _fitted(self, points_w: Array, aspect: float) -> Viewpoint:
        return fit_viewpoint(
            points_w,
            azimuth_deg=front_azimuth_deg(self._subject.asset) + AZIMUTH_OFF_FRONT_DEG,
            elevation_deg=ELEVATION_DEG,
            fov_deg=FIELD_OF_VIEW_DEG,
            aspect=aspect,
        )


def _set_stage(spec: mujoco.MjSpec, asset: Asset, size: tuple[int, int]) -> None:
    """Add a floor, a sky and two lights."""
    low, high = (np.asarray(corner) for corner in asset.bounds_o)
    extent = max(float(np.linalg.norm(high - low)), 1e-3)
    add_sky(spec, 128, ZENITH_RGB, HORIZON_RGB)
    floor = spec.worldbody.add_geom(name="stage_floor", type=mujoco.mjtGeom.mjGEOM_PLANE)
    floor.size = [0.0, 0.0, 0.05]
    floor.pos = [0.0, 0.0, float(low[2]) - 0.002 * extent]
    floor.rgba = [*FLOOR_RGB, 1.0]
    floor.contype, floor.conaffinity, floor.group = 0, 0, VISIBLE
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
