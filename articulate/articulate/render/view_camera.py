"""Viewpoints that show given points completely."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from articulate.simulator import mujoco
from articulate.transforms import Array

MARGIN = 1.06
"""Margin around the points, as a factor on the distance."""
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
"""Corners of a box of half sides 1."""


@dataclass(frozen=True, kw_only=True)
class Viewpoint:
    """Position and direction of a camera, in MuJoCo's convention."""

    lookat_w: tuple[float, float, float]
    """Point at the image centre [m]."""
    distance_m: float
    """Distance from the camera to that point [m]."""
    azimuth_deg: float
    """Direction of view about the vertical [deg]; 0 looks along +x, 90 along +y."""
    elevation_deg: float
    """Direction of view above the horizon [deg]; negative looks down."""

    def camera(self) -> mujoco.MjvCamera:
        """Return the free camera of MuJoCo at this viewpoint."""
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = self.lookat_w
        camera.distance = self.distance_m
        camera.azimuth, camera.elevation = self.azimuth_deg, self.elevation_deg
        return camera


def fit_viewpoint(
    points_w: Array, *, azimuth_deg: float, elevation_deg: float, fov_deg: float, aspect: float
) -> Viewpoint:
    """Return the closest viewpoint in a given direction that shows all points.

    Args:
        points_w: Points to show (P, 3) [m].
        azimuth_deg: Direction about the vertical [deg].
        elevation_deg: Direction above the horizon [deg].
        fov_deg: Vertical field of view [deg].
        aspect: Width of the image over its height.
    """
    ahead, right, up = camera_axes(azimuth_deg, elevation_deg)
    tangent = np.tan(np.deg2rad(fov_deg) / 2.0)
    depth, across, over = points_w @ ahead, points_w @ right, points_w @ up
    # A point is inside if |across - a| <= aspect * tangent * (depth - d), d the camera's depth:
    # two slanted edges that meet the outermost points give a and the largest d, as over does.
    spots = []
    for value, slope in ((across, aspect * tangent), (over, tangent)):
        low, high = np.min(value + slope * depth), np.max(value - slope * depth)
        spots.append(((low + high) / 2.0, (low - high) / (2.0 * slope)))
    middle = float(np.mean([depth.min(), depth.max()]))
    camera = min(d for _, d in spots)
    distance = MARGIN * (middle - camera)
    lookat = spots[0][0] * right + spots[1][0] * up + middle * ahead
    return Viewpoint(
        lookat_w=(float(lookat[0]), float(lookat[1]), float(lookat[2])),
        distance_m=float(distance),
        azimuth_deg=azimuth_deg,
        elevation_deg=elevation_deg,
    )


def camera_axes(azimuth_deg: float, elevation_deg: float) -> tuple[Array, Array, Array]:
    """Return unit vectors (3,) of a camera in the world frame: forward, right, up."""
    a, e = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    ahead = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return ahead, right, np.cross(right, ahead)


def geom_corners(model: mujoco.MjModel, data: mujoco.MjData, geoms: Iterable[int]) -> Array:
    """Return the corners of the bounding boxes of some geoms in the world frame (8 G, 3) [m]."""
    out = []
    for i in geoms:
        corners = model.geom_aabb[i, :3] + model.geom_aabb[i, 3:] * CORNERS
        out.append(corners @ data.geom_xmat[i].reshape(3, 3).T + data.geom_xpos[i])
    return np.concatenate(out)
