"""Perturbations of evidence: a wrong camera, noise, changing light and textures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from articulate.benchmark.truth import TrueObject
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.raster import Pixels
from articulate.transforms import apply, axis_angle_to_matrix, normalised, pose

CAMERA_ANGLE_RAD = float(np.radians(5.0))
"""Rotation of the camera about the object's centre."""
DISTANCE_SHARE = 0.05
"""Change of the camera's distance, as a share of it."""
NOISE = 4.0
"""Standard deviation of the noise of each pixel and colour channel, of 255."""
LIGHT_SHARE = 0.08
"""Largest change of a frame's brightness, as a share of it."""
TEXELS = 64
TEXTURE_RANGE = (0.65, 1.0)
"""Lowest and highest factor of a texture on the colour of a face."""
REPEATS = 1.5
"""Repeats of a texture along one unit of length."""


def camera_off(camera: Camera, subject: TrueObject, rng: np.random.Generator) -> Camera:
    """Return a wrong camera.

    It is rotated about the object's centre by :data:`CAMERA_ANGLE_RAD` about a random axis, and its
    distance is changed by :data:`DISTANCE_SHARE`.
    """
    centre = joint_bounds(subject.parts).mean(axis=0)
    axis = normalised(rng.normal(size=3))
    turn = axis_angle_to_matrix(axis, CAMERA_ANGLE_RAD)
    T = pose(centre - turn @ centre, turn) @ camera.T_wc
    share = DISTANCE_SHARE if rng.random() < 0.5 else -DISTANCE_SHARE
    T[:3, 3] += share * (apply(T, np.zeros(3)) - centre)
    return camera.at(T)


def noisy_frames(frames: Pixels, rng: np.random.Generator) -> Pixels:
    """Add noise to frames (T, H, W, 3), and change the brightness of each."""
    out = np.empty_like(frames)
    for i, frame in enumerate(frames):
        light = 1.0 + LIGHT_SHARE * rng.uniform(-1.0, 1.0)
        noise = NOISE * rng.standard_normal(frame.shape, dtype=np.float32)
        out[i] = np.clip(np.rint(light * frame + noise), 0, 255).astype(np.uint8)
    return out


def textured(part: PartMesh, rng: np.random.Generator) -> PartMesh:
    """Return the part with a random texture on every face, projected along its main axis."""
    coarse = rng.uniform(*TEXTURE_RANGE, (TEXELS // 4, TEXELS // 4))
    fine = np.kron(coarse, np.ones((4, 4))) * rng.uniform(0.85, 1.0, (TEXELS, TEXELS))
    texture = np.rint(255.0 * fine[..., None].repeat(3, axis=-1)).astype(np.uint8)
    corners = part.vertices[part.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.abs(normal).argmax(axis=1)
    across = np.array([[1, 2], [0, 2], [0, 1]])[facing]
    uv = REPEATS * np.take_along_axis(corners, across[:, None, :].repeat(3, axis=1), axis=2)
    return replace(part, uv=uv, texture=texture)
