"""Floor, plinths, lights and colours of rendered scenes."""

from __future__ import annotations

import numpy as np

from articulate.assets.asset import Asset
from articulate.render.scene_style import HORIZON_RGB, add_sky, part_rgba
from articulate.simulator import mujoco
from articulate.transforms import Array
from articulate_envs.scene import PREFIX

FLOOR_RGB = ((0.80, 0.82, 0.83), (0.775, 0.795, 0.81))
"""The two shades of the floor's tiles."""
STAND_RGBA = (0.36, 0.39, 0.43, 1.0)
TILE_M = 0.5
FIELD_OF_VIEW_DEG = 34.0
"""Vertical field of view [deg]; small, to limit perspective distortion."""
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)


def add_scene_visuals(
    spec: mujoco.MjSpec, asset: Asset, *, scale: float, T_wo: Array, size: tuple[int, int]
) -> None:
    """Replace floor, plinths, sky and lights of ``spec`` and colour an object without colours.

    Args:
        spec: Scene with visual geoms.
        asset: Its object.
        scale: Size factor of the object.
        T_wo: Pose of the object in the world (4, 4), homogeneous.
        size: Width and height of images [px].
    """
    for name in ("floor", "robot_stand", "object_stand"):
        geom = spec.geom(name)
        if geom is not None:
            spec.delete(geom)
    for light in list(spec.lights):
        spec.delete(light)
    bottom = float(T_wo[2, 3])
    floor_z = min(0.0, bottom)
    _add_floor(spec, floor_z)
    _add_stand(spec, (0.0, 0.0), (0.11, 0.11), floor_z, 0.0, 0.0)
    low, high = scale * np.asarray(asset.bounds_o)
    middle = T_wo[:3, :3] @ np.append((low + high)[:2] / 2.0, 0.0) + T_wo[:3, 3]
    half = (high - low)[:2] / 2.0 - 0.01
    yaw = float(np.arctan2(T_wo[1, 0], T_wo[0, 0]))
    _add_stand(spec, (middle[0], middle[1]), (half[0], half[1]), floor_z, bottom, yaw)
    _add_lights(spec)
    _paint(spec)
    quality, view = spec.visual.quality, spec.visual.global_
    view.offwidth, view.offheight = size
    view.fovy = FIELD_OF_VIEW_DEG
    quality.shadowsize = 4096
    quality.offsamples = 4


def _add_floor(spec: mujoco.MjSpec, floor_z: float) -> None:
    add_sky(spec, 256)
    spec.add_texture(
        name="stage_floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=FLOOR_RGB[0],
        rgb2=FLOOR_RGB[1],
        width=256,
        height=256,
    )
    material = spec.add_material(name="stage_floor")
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "stage_floor"
    material.texrepeat = [1.0 / (2.0 * TILE_M)] * 2
    material.texuniform = True
    material.specular, material.shininess, material.reflectance = 0.1, 0.1, 0.0
    floor = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE)
    floor.size = [0.0, 0.0, 0.05]
    floor.pos = [0.0, 0.0, floor_z]
    floor.material = "stage_floor"
    floor.contype, floor.conaffinity, floor.group = 0, 0, 2
    spec.visual.rgba.haze = [*HORIZON_RGB, 1.0]
    spec.visual.map.haze = 0.4


def _add_stand(
    spec: mujoco.MjSpec,
    middle: tuple[float, float],
    half: tuple[float, float],
    floor_z: float,
    top: float,
    yaw_rad: float,
) -> None:
    """Add a plinth below an object above the floor."""
    height = top - floor_z
    if height < 0.01:
        return
    box = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX)
    box.size = [half[0], half[1], height / 2.0 - 0.0005]
    box.pos = [middle[0], middle[1], floor_z + height / 2.0 - 0.0005]
    box.quat = [np.cos(yaw_rad / 2.0), 0.0, 0.0, np.sin(yaw_rad / 2.0)]
    box.contype, box.conaffinity, box.group = 0, 0, 2
    box.rgba = STAND_RGBA


def _add_lights(spec: mujoco.MjSpec) -> None:
    head = spec.visual.headlight
    head.ambient, head.diffuse, head.specular = [0.38] * 3, [0.20] * 3, [0.0] * 3
    for pos, direction, strength, casts in (
        ((-0.6, -1.2, 3.0), (0.35, 0.45, -1.0), 0.44, True),
        ((-0.6, 1.6, 2.2), (0.4, -0.7, -0.8), 0.15, False),
    ):
        light = spec.worldbody.add_light()
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        light.pos, light.dir = pos, direction
        light.ambient, light.diffuse, light.specular = [0.0] * 3, [strength] * 3, [0.15] * 3
        light.castshadow = casts


def _paint(spec: mujoco.MjSpec) -> None:
    """Show collision geoms of an object without visual geoms; colour geoms without a colour."""
    own = [g for g in spec.geoms if g.parent.name.startswith(PREFIX)]
    seen = [g for g in own if g.contype == 0 and g.conaffinity == 0]
    links = [b.name for b in spec.bodies if b.name.startswith(PREFIX)]
    for geom in seen or own:
        geom.group = 2
        k = links.index(geom.parent.name)
        if not geom.material and np.allclose(geom.rgba, _DEFAULT_RGBA):
            geom.rgba = part_rgba(k)
