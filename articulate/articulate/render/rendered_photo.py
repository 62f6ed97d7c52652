"""Rendered photos of objects: unknown camera, light, textured background, occluding arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.render.camera import Camera, look_at, pinhole
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.raster import Pixels
from articulate.render.scene import NO_PART, Light, PartScene

AZIMUTH_DEG, ELEVATION_DEG = (-60.0, 60.0), (0.0, 50.0)
FOCAL_MM = (24.0, 70.0)
"""Focal length equivalent to a sensor of 36 mm x 24 mm."""
FILL = (0.55, 0.85)
"""Share of the image's smaller relative side that the object spans."""
LONG_PX, SHORT_PX = 640, 480


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedPhoto:
    """Image with its truth."""

    image: Pixels
    """Colours (H, W, 3), 0 to 255."""
    camera: Camera
    """Camera in the frame of the parts."""
    mask: NDArray[np.bool_]
    """Object pixels that nothing occludes (H, W), boolean."""


def render_photo(
    parts: Sequence[PartMesh], seed: int, *, occluded: bool = False, plain: bool = False
) -> RenderedPhoto:
    """Render parts that stand on z = 0 with their front at +x.

    Args:
        parts: Parts in the scene frame.
        seed: Seed of camera, light and background.
        occluded: Add a capsule like an arm before the object.
        plain: White background.
    """
    rng = np.random.default_rng(seed)
    camera = sample_camera(parts, rng)
    scene = PartScene(parts, sample_light(rng))
    seen = scene.rasterize(camera)
    image = scene.render_image(camera)
    mask = seen.part_ids != NO_PART
    if not plain:
        image = np.where(mask[..., None], image, background(camera, rng))
        image = _degraded(image, rng)
    if occluded:
        image, mask = _with_arm(image, mask, rng)
    return RenderedPhoto(image=np.asarray(image, dtype=np.uint8), camera=camera, mask=mask)


def sample_camera(parts: Sequence[PartMesh], rng: np.random.Generator) -> Camera:
    """Sample a camera that sees all parts, from the front."""
    azimuth = np.radians(rng.uniform(*AZIMUTH_DEG))
    elevation = np.radians(rng.uniform(*ELEVATION_DEG))
    focal = rng.uniform(*FOCAL_MM)
    low, high = joint_bounds(parts)
    upright = (high - low)[2] > 1.2 * (high - low)[1]
    width, height = (SHORT_PX, LONG_PX) if upright else (LONG_PX, SHORT_PX)
    fovy = 2.0 * np.arctan(0.5 * 36.0 * height / max(width, height) / focal)
    target = 0.5 * (low + high) + 0.05 * rng.normal(size=3) * (high - low)
    towards = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = low + corners * (high - low)
    wanted = rng.uniform(*FILL)
    near, far = 0.0, 40.0 * float(np.linalg.norm(high - low))
    for _ in range(40):
        distance = 0.5 * (near + far)
        camera = pinhole(
            width_px=width,
            height_px=height,
            fovy_rad=float(fovy),
            T_wc=look_at(target + distance * towards, target),
        )
        uv, depth = camera.project(corners)
        spread = np.abs(uv - [width / 2, height / 2]).max(axis=0) / [width / 2, height / 2]
        if (depth > 0.0).all() and np.isfinite(spread).all() and spread.max() < wanted:
            far = distance
        else:
            near = distance
    return camera


def sample_light(rng: np.random.Generator) -> Light:
    """Sample a light from the front and above."""
    direction = (rng.uniform(-1.0, 0.2), rng.uniform(-1.0, 1.0), rng.uniform(-1.5, -0.5))
    return Light(
        direction_w=direction, ambient=rng.uniform(0.35, 0.55), directional=rng.uniform(0.2, 0.5)
    )


def background(camera: Camera, rng: np.random.Generator) -> Pixels:
    """Return a textured wall and floor with shapes (H, W, 3), 0 to 255."""
    height, width = camera.height_px, camera.width_px
    out = np.zeros((height, width, 3), dtype=np.float32)
    horizon = int(height * rng.uniform(0.35, 0.8))
    for rows in (slice(0, horizon), slice(horizon, height)):
        colour = rng.uniform(70, 230, size=3) * 0.5 + 0.5 * rng.uniform(90, 220)
        out[rows] = colour
    for scale in (4, 16, 64):
        coarse = rng.normal(size=(height // scale + 2, width // scale + 2, 1)).astype(np.float32)
        fine = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        out += rng.uniform(1.0, 9.0) * fine[..., None]
    for _ in range(int(rng.integers(2, 9))):
        first = rng.integers(0, [width, height])
        second = first + rng.integers(20, 220, size=2)
        shade = tuple(float(c) for c in rng.uniform(30, 240, size=3))
        thickness = int(rng.choice([-1, 2, 4]))
        ends = [(int(x), int(y)) for x, y in (first, second)]
        cv2.rectangle(out, ends[0], ends[1], shade, thickness)
    return np.clip(cv2.GaussianBlur(out, (0, 0), 0.8), 0, 255).astype(np.uint8)


def _degraded(image: Pixels, rng: np.random.Generator) -> Pixels:
    """Add blur, noise and JPEG compression."""
    soft = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.0)).astype(np.float32)
    noisy = np.clip(soft + rng.normal(size=soft.shape) * rng.uniform(1.0, 5.0), 0, 255)
    quality = int(rng.integers(60, 95))
    _, packed = cv2.imencode(".jpg", noisy.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), dtype=np.uint8)


def _with_arm(
    image: Pixels, mask: NDArray[np.bool_], rng: np.random.Generator
) -> tuple[Pixels, NDArray[np.bool_]]:
    """Add a thick line from the border to a point on the object."""
    height, width = mask.shape
    rows, columns = np.nonzero(mask)
    k = int(rng.integers(len(rows)))
    start = (int(rng.choice([0, width - 1])), int(rng.uniform(0.3, 1.0) * height))
    thickness = int(rng.uniform(0.05, 0.11) * width)
    colour = tuple(float(c) for c in np.array([200, 160, 130]) * rng.uniform(0.4, 1.1))
    out, arm = image.copy(), np.zeros(mask.shape, dtype=np.uint8)
    end = (int(columns[k]), int(rows[k]))
    cv2.line(out, start, end, colour, thickness, cv2.LINE_AA)
    cv2.line(arm, start, end, 1, thickness)
    return out, mask & (arm == 0)
