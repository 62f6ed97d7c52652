"""What makes evidence worse: a camera that stands elsewhere than told, noise, light, texture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from articulate.benchmark.truth import TrueObject
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.raster import Pixels
from articulate.transforms import apply, axis_angle_to_matrix, normalised, pose

OFF_RAD = float(np.radians(5.0))
"""How far the camera told is turned about the object's middle."""
OFF_SHARE = 0.05
"""How much nearer or farther it is told to stand."""
NOISE = 4.0
"""Standard deviation of the noise of each pixel and colour, of 255."""
LIGHT_SHARE = 0.08
"""How much brighter or darker a frame may be."""
TEXELS = 64
MOTTLE = (0.65, 1.0)
"""Lowest and highest factor of a texture on what it covers."""
REPEATS = 1.5
"""How often a texture is repeated along one unit of length."""


def camera_off(camera: Camera, subject: TrueObject, rng: np.random.Generator) -> Camera:
    """A camera as somebody would tell it wrongly.

    It is carried round the object's middle by :data:`OFF_RAD` about an axis drawn at random, and
    stands nearer or farther by :data:`OFF_SHARE`.
    """
    middle = joint_bounds(subject.parts).mean(axis=0)
    axis = normalised(rng.normal(size=3))
    turn = axis_angle_to_matrix(axis, OFF_RAD)
    T = pose(middle - turn @ middle, turn) @ camera.T_wc
    share = OFF_SHARE if rng.random() < 0.5 else -OFF_SHARE
    T[:3, 3] += share * (apply(T, np.zeros(3)) - middle)
    return camera.at(T)


def noisy_frames(frames: Pixels, rng: np.random.Generator) -> Pixels:
    """The frames (T, H, W, 3) with noise, each in light of its own."""
    out = np.empty_like(frames)
    for i, frame in enumerate(frames):
        light = 1.0 + LIGHT_SHARE * rng.uniform(-1.0, 1.0)
        noise = NOISE * rng.standard_normal(frame.shape, dtype=np.float32)
        out[i] = np.clip(np.rint(light * frame + noise), 0, 255).astype(np.uint8)
    return out


def textured(part: PartMesh, rng: np.random.Generator) -> PartMesh:
    """The part with a mottled texture on every face, laid on along the axis it faces most."""
    coarse = rng.uniform(*MOTTLE, (TEXELS // 4, TEXELS // 4))
    fine = np.kron(coarse, np.ones((4, 4))) * rng.uniform(0.85, 1.0, (TEXELS, TEXELS))
    texture = np.rint(255.0 * fine[..., None].repeat(3, axis=-1)).astype(np.uint8)
    corners = part.vertices[part.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.abs(normal).argmax(axis=1)
    across = np.array([[1, 2], [0, 2], [0, 1]])[facing]
    uv = REPEATS * np.take_along_axis(corners, across[:, None, :].repeat(3, axis=1), axis=2)
    return replace(part, uv=uv, texture=texture)
