"""Images of flat markers and boards in perspective, with noise, blur and occlusion.

Every pixel is the mean of a grid of rays through the lens, so that edges fall between pixels as in
a photo. Tests, benchmarks and the camera of a simulated robot use it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.markers.camera_calibration import CameraCalibration
from articulate.markers.layout import DICTIONARIES, Marker
from articulate.transforms import Array, apply

Pixels = NDArray[np.uint8]
MODULE_PX = 16
"""Pixels of a module in the texture of a marker."""
BLACK, WHITE, GREY = 35.0, 215.0, 120.0
"""Gray values of print, paper and background."""


@dataclass(frozen=True, kw_only=True)
class ImageNoise:
    """Imperfections of an image."""

    sigma: float = 4.0
    """Standard deviation of the noise of a pixel, of 255."""
    blur_px: float = 0.6
    """Standard deviation of the blur of lens and sensor [px]."""
    motion_px: float = 0.0
    """Length of the motion blur along the rows [px]."""
    gain: float = 1.0
    """Factor on the brightness."""


NO_NOISE = ImageNoise(sigma=0.0, blur_px=0.0)
"""Image without noise and blur."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Flat print: a texture with its size and its pose."""

    texture: Pixels
    """Print, (H, W), values 0 to 255; row 0 is the upper edge."""
    size_m: tuple[float, float]
    """Width and height [m]."""
    T_cp: Array
    """Pose of the center in the camera frame (4, 4) [m]: x right, y up, z out of the print."""


@dataclass(frozen=True, eq=False)
class Occluder:
    """Convex region of the image that covers what is behind it."""

    outline: Array
    """Outline (N, 2) [px]."""
    depth_m: float = 0.0
    """Distance from the camera [m]; planes that are nearer are not covered."""
    value: float = 90.0
    """Gray value."""


def marker_texture(dictionary: str, number: int) -> Pixels:
    """Return the print of a marker with a white margin of one module (H, W), values 0 to 255."""
    name, _, modules = DICTIONARIES[dictionary]
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    side = (modules + 2) * MODULE_PX
    print_ = cv2.aruco.generateImageMarker(known, number, side)
    out = np.full((side + 2 * MODULE_PX, side + 2 * MODULE_PX), 255, dtype=np.uint8)
    out[MODULE_PX:-MODULE_PX, MODULE_PX:-MODULE_PX] = print_
    return out


def marker_plane(dictionary: str, marker: Marker, T_cm: Array) -> Plane:
    """Return the print of ``marker`` with its margin at pose ``T_cm`` (4, 4) [m]."""
    modules = DICTIONARIES[dictionary][2]
    side = marker.size_m * (modules + 4) / (modules + 2)
    return Plane(marker_texture(dictionary, marker.id), (side, side), T_cm)


def render_planes(
    calibration: CameraCalibration,
    planes: Sequence[Plane],
    rng: np.random.Generator,
    *,
    noise: ImageNoise | None = None,
    occluders: Sequence[Occluder] = (),
    samples: int = 3,
) -> Pixels:
    """Return a gray image (H, W) of planes, values 0 to 255.

    Args:
        calibration: Intrinsics of the camera.
        planes: Prints; nearer ones cover farther ones.
        rng: Generator of the background and the noise.
        noise: Imperfections; None: the defaults.
        occluders: Regions that cover the planes behind them.
        samples: Rays in each direction of a pixel.
    """
    noise = noise or ImageNoise()
    height, width = calibration.height_px, calibration.width_px
    coarse = rng.normal(size=(height // 60 + 2, width // 60 + 2)).astype(np.float32)
    image: Any = GREY + 18.0 * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    items: list[tuple[float, Plane | Occluder]] = [
        *((float(plane.T_cp[2, 3]), plane) for plane in planes),
        *((occluder.depth_m, occluder) for occluder in occluders),
    ]
    for _, item in sorted(items, key=lambda pair: -pair[0]):
        if isinstance(item, Plane):
            _paint(image, calibration, item, samples)
        elif len(item.outline) > 2:
            hull = cv2.convexHull(item.outline.astype(np.float32))
            cv2.fillConvexPoly(image, np.rint(hull).astype(np.int32), item.value)
    image = noise.gain * image
    if noise.motion_px > 0.0:
        n = max(1, round(noise.motion_px))
        image = cv2.blur(image, (n, 1))
    if noise.blur_px > 0.0:
        image = cv2.GaussianBlur(image, (0, 0), noise.blur_px)
    if noise.sigma > 0.0:
        image = image + noise.sigma * rng.standard_normal(image.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(image), 0, 255), dtype=np.uint8)


def _paint(
    image: NDArray[np.float32], calibration: CameraCalibration, plane: Plane, samples: int
) -> None:
    """Paint a plane into ``image`` (H, W), in place, where its printed side faces the camera."""
    T = plane.T_cp
    w, h = plane.size_m
    corners_p = 0.5 * np.array([(-w, h, 0.0), (w, h, 0.0), (w, -h, 0.0), (-w, -h, 0.0)])
    corners_c = apply(T, corners_p)
    if corners_c[:, 2].min() < 1e-3 or float(T[:3, 2] @ T[:3, 3]) >= 0.0:
        return
    uv = calibration.projected(_outline(corners_c))
    low = np.maximum(np.floor(uv.min(axis=0)) - 2, 0).astype(int)
    high = np.minimum(
        np.ceil(uv.max(axis=0)) + 3, (calibration.width_px, calibration.height_px)
    ).astype(int)
    if (high <= low).any():
        return
    rays = _rays(calibration, low, high, samples)
    to_plane = np.linalg.inv(np.stack([T[:3, 0], T[:3, 1], T[:3, 3]], axis=-1))
    x, y, z = np.moveaxis(rays @ to_plane.T, -1, 0)
    rows, columns = plane.texture.shape
    u = (x / z / w + 0.5) * columns - 0.5
    v = (0.5 - y / z / h) * rows - 0.5
    texture = BLACK + (WHITE - BLACK) / 255.0 * plane.texture.astype(np.float32)
    colour = cv2.remap(
        texture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, None,
        cv2.BORDER_REPLICATE,
    )  # fmt: skip
    inside = (u > -0.5) & (u < columns - 0.5) & (v > -0.5) & (v < rows - 0.5)
    shape = (high[1] - low[1], samples, high[0] - low[0], samples)
    share = inside.reshape(shape).mean(axis=(1, 3))
    painted = np.where(inside, colour, 0.0).reshape(shape).mean(axis=(1, 3))
    region = image[low[1] : high[1], low[0] : high[0]]
    region *= 1.0 - share.astype(np.float32)
    region += painted.astype(np.float32)


def _outline(corners_c: Array) -> Array:
    """Return points along the edges of a plane (40, 3), as lenses bend straight lines [m]."""
    share = np.linspace(0.0, 1.0, 10, endpoint=False)[:, None]
    after = np.roll(corners_c, -1, axis=0)
    return np.concatenate([a + share * (b - a) for a, b in zip(corners_c, after, strict=True)])


def _rays(
    calibration: CameraCalibration, low: NDArray[np.int64], high: NDArray[np.int64], samples: int
) -> Array:
    """Return rays with z = 1 of a grid of samples of a region (H samples, W samples, 3)."""
    u, v = (
        (np.arange(samples * (high[k] - low[k])) + 0.5) / samples - 0.5 + low[k] for k in range(2)
    )
    grid = np.stack(np.meshgrid(u, v), axis=-1)
    K = calibration.K
    if np.any(calibration.dist):
        xy = calibration.undistorted(grid)
    else:
        y = (grid[..., 1] - K[1, 2]) / K[1, 1]
        xy = np.stack([(grid[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0], y], axis=-1)
    return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)
