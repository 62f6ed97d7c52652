"""Random surroundings of rendered videos: textures, room, clutter, an operator's arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import trimesh

from articulate.render.parts import PartMesh, plain_part
from articulate.render.raster import Pixels
from articulate.transforms import Array, normalised, pose

TEXTURE_PX = 192
"""Side of a texture [px]."""
SKIN_RGB = ((0.94, 0.78, 0.68), (0.87, 0.66, 0.53), (0.72, 0.50, 0.37), (0.45, 0.30, 0.22))
"""Albedo of skin."""


def noise(rng: np.random.Generator, octaves: Sequence[int], stretch: float = 1.0) -> Array:
    """Return smooth noise (``TEXTURE_PX``, ``TEXTURE_PX``) of about mean 0 and deviation 1.

    Args:
        rng: Random numbers.
        octaves: Number of cells along the side, for each layer.
        stretch: Number of cells across, divided by that along.
    """
    total = np.zeros((TEXTURE_PX, TEXTURE_PX))
    for cells in octaves:
        across = max(2, round(cells / stretch))
        small = rng.standard_normal((max(2, cells), across)).astype(np.float32)
        total += cv2.resize(small, (TEXTURE_PX, TEXTURE_PX), interpolation=cv2.INTER_CUBIC)
    return np.asarray((total - total.mean()) / max(float(total.std()), 1e-6))


def sample_texture(rng: np.random.Generator, strength: float) -> Pixels:
    """Return a random texture (H, W, 3), 0 to 255, to be multiplied by a colour.

    Args:
        rng: Random numbers.
        strength: Contrast; 0 gives a plain surface.
    """
    kind = rng.choice(["noise", "wood", "tiles", "plain"], p=[0.4, 0.25, 0.15, 0.2])
    if kind == "noise":
        shade = noise(rng, rng.integers(3, 60, size=3).tolist())
    elif kind == "wood":
        shade = noise(rng, [int(rng.integers(20, 70)), int(rng.integers(8, 30))], stretch=12.0)
        shade = 0.7 * shade + 0.5 * np.sin(3.0 * shade)
        if rng.random() < 0.5:
            shade = shade.T
    elif kind == "tiles":
        pitch = int(rng.integers(24, 97))
        shade = 0.4 * noise(rng, [int(rng.integers(3, 40))])
        line = max(1, pitch // 16)
        shade[np.arange(TEXTURE_PX) % pitch < line] -= 2.0
        shade[:, np.arange(TEXTURE_PX) % pitch < line] -= 2.0
    else:
        shade = 0.15 * noise(rng, [int(rng.integers(2, 8)), 90])
    grey = 205.0 * (1.0 + strength * shade)
    tint = 1.0 + 0.3 * strength * rng.standard_normal(3)
    image = np.clip(grey[..., None] * tint, 0, 255).astype(np.uint8)
    image = np.ascontiguousarray(image)
    if rng.random() < 0.35 * min(1.0, 4.0 * strength):
        _add_labels(rng, image)
    return image


def _add_labels(rng: np.random.Generator, image: Pixels) -> None:
    """Add stickers and letters to a texture, in place."""
    size = image.shape[0]
    for _ in range(int(rng.integers(1, 6))):
        u, v = (int(x) for x in rng.integers(0, size - 30, size=2))
        w, h = (int(x) for x in rng.integers(8, size // 3, size=2))
        colour = [int(x) for x in rng.integers(20, 256, size=3)]
        if rng.random() < 0.5:
            cv2.rectangle(image, (u, v), (u + w, v + h), colour, -1)
        else:
            cv2.ellipse(image, (u, v), (w // 2 + 1, h // 2 + 1), 0, 0, 360, colour, -1)
        letters = "".join(chr(int(c)) for c in rng.integers(65, 91, size=4))
        scale = float(rng.uniform(0.4, 1.0))
        ink = [int(x) for x in rng.integers(0, 120, size=3)]
        cv2.putText(image, letters, (u, v + 12), cv2.FONT_HERSHEY_SIMPLEX, scale, ink, 1)


def textured(
    part: PartMesh, rng: np.random.Generator, strength: float, tile: float, *, recolour: bool
) -> PartMesh:
    """Return a part with a random texture, projected along the main direction of each face.

    Args:
        part: The part; its own texture, if any, is kept.
        rng: Random numbers.
        strength: Contrast of the texture.
        tile: Side of the surface that one texture covers [m].
        recolour: Replace the colours of the faces.
    """
    rgb = part.rgb
    if recolour:
        rgb = np.broadcast_to(rng.uniform(0.1, 1.0, size=3), rgb.shape).copy()
    if part.texture is not None and part.uv is not None:
        return part
    corners = part.vertices[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    main = np.argmax(np.abs(normals), axis=1)
    keep = np.array([[1, 2], [0, 2], [0, 1]])[main]
    uv = np.take_along_axis(corners, keep[:, None, :].repeat(3, axis=1), axis=2)
    uv = uv / tile + 0.37 * main[:, None, None]
    return replace(part, rgb=rgb, uv=uv, texture=sample_texture(rng, strength))


def _box(name: str, low: Array, high: Array, rgb: Array) -> PartMesh:
    mesh = trimesh.creation.box(bounds=np.stack([low, high]))
    return plain_part(name, mesh.vertices, mesh.faces, rgb.tolist())


def sample_room(rng: np.random.Generator, low: Array, high: Array) -> list[PartMesh]:
    """Return a floor, walls and clutter around an object that faces +x.

    Args:
        rng: Random numbers.
        low: Lowest corner of the object (3,) [m].
        high: Highest corner (3,) [m].
    """
    strength = float(np.exp(rng.uniform(np.log(0.04), np.log(0.5))))
    size = float(np.linalg.norm(high - low))
    back = low[0] - size * rng.uniform(0.02, 0.8)
    drop = 0.0 if rng.random() < 0.6 else size * rng.uniform(0.3, 1.0)
    wide = 12.0 * size
    floor = _box(
        "floor",
        np.array([back - 0.5, -wide, -drop - 0.05]),
        np.array([wide, wide, -drop - 0.001]),
        rng.uniform(0.2, 1.0, size=3),
    )
    wall = _box(
        "wall",
        np.array([back - 0.4, -wide, -drop]),
        np.array([back, wide, wide]),
        rng.uniform(0.2, 1.0, size=3),
    )
    parts = [floor, wall]
    if drop > 0.0:  # the object is placed on a table
        edge = rng.uniform(0.05, 0.5, size=4) * size
        parts.append(
            _box(
                "table",
                np.array([low[0] - edge[0], low[1] - edge[1], -0.05 * size]),
                np.array([high[0] + edge[2], high[1] + edge[3], -0.002]),
                rng.uniform(0.2, 1.0, size=3),
            )
        )
    for k in range(int(rng.integers(0, 7))):
        extent = size * rng.uniform(0.08, 0.5, size=3)
        side = rng.choice([-1.0, 1.0])
        y = side * (0.5 * size + extent[1] + rng.uniform(0.0, 0.8) * size)
        centre = np.array([rng.uniform(back, high[0] + 0.3 * size), y, -drop + extent[2]])
        parts.append(_box(f"clutter_{k}", centre - extent, centre + extent, rng.uniform(0, 1, 3)))
    tile = float(rng.uniform(0.25, 0.9)) * size
    return [textured(part, rng, strength, tile, recolour=False) for part in parts]


@dataclass(frozen=True, kw_only=True, eq=False)
class Arm:
    """An operator's arm of three rigid parts: palm, forearm and upper arm."""

    parts: tuple[PartMesh, PartMesh, PartMesh]
    """Palm at the origin with the wrist at -z; forearm and upper arm from the origin along +z."""
    length: float
    """Length of forearm and of upper arm [m]."""
    radius: float
    """Radius of the palm [m]."""

    def poses(self, palm_w: Array, shoulder_w: Array, bend_w: Array) -> Array:
        """Return the poses of the three parts (3, 4, 4).

        Args:
            palm_w: Position of the palm (3,) [m].
            shoulder_w: Position of the shoulder (3,) [m].
            bend_w: Direction in which the elbow points (3,).
        """
        span = shoulder_w - palm_w
        distance = float(np.linalg.norm(span))
        ahead = span / max(distance, 1e-9)
        bend = normalised(bend_w - ahead * float(bend_w @ ahead))
        half = 0.5 * min(distance, 1.98 * self.length)
        elbow = palm_w + ahead * half + bend * np.sqrt(self.length**2 - half**2)
        return np.stack(
            [
                pose(palm_w, _frame(palm_w - elbow)),
                pose(palm_w, _frame(elbow - palm_w)),
                pose(elbow, _frame(shoulder_w - elbow)),
            ]
        )


def _frame(z: Array) -> Array:
    """Return a rotation matrix (3, 3) whose third column points along ``z``."""
    z = normalised(z)
    helper = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    x = normalised(np.cross(helper, z))
    return np.stack([x, np.cross(z, x), z], axis=-1)


def sample_arm(rng: np.random.Generator, reach: float, radius: float) -> Arm:
    """Return an arm of a person or a robot.

    Args:
        rng: Random numbers.
        reach: Largest distance from palm to shoulder [m].
        radius: Radius of the palm [m].
    """
    length = 0.55 * reach
    robot = rng.random() < 0.25
    skin = rng.uniform(0.1, 0.9) * np.ones(3) if robot else np.array(SKIN_RGB[rng.integers(4)])
    sleeve = rng.uniform(0.05, 0.95, size=3) if rng.random() < 0.6 else skin
    palm = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    palm.apply_scale([1.0, float(rng.uniform(0.35, 0.8)), float(rng.uniform(1.0, 1.6))])
    fingers = []
    for k in range(int(rng.integers(2, 5))):
        finger = trimesh.creation.capsule(height=0.9 * radius, radius=0.2 * radius, count=[6, 8])
        finger.apply_translation([(k - 1.5) * 0.42 * radius, 0.3 * radius, 0.8 * radius])
        fingers.append(finger)
    merged = trimesh.util.concatenate([palm, *fingers])
    parts = [plain_part("palm", merged.vertices, merged.faces, skin.tolist())]
    for name, thick, colour in (
        ("forearm", rng.uniform(0.5, 0.75), skin if rng.random() < 0.5 else sleeve),
        ("upper_arm", rng.uniform(0.7, 1.1), sleeve),
    ):
        limb = trimesh.creation.capsule(height=length, radius=thick * radius, count=[10, 10])
        parts.append(plain_part(name, limb.vertices, limb.faces, np.asarray(colour).tolist()))
    strength = float(rng.uniform(0.02, 0.25))
    painted = [textured(p, rng, strength, 5.0 * radius, recolour=False) for p in parts]
    return Arm(parts=(painted[0], painted[1], painted[2]), length=length, radius=radius)


def sample_person(rng: np.random.Generator, height: float) -> PartMesh:
    """Return a rough person of ``height`` [m] at the origin."""
    radius = height * rng.uniform(0.09, 0.14)
    torso = trimesh.creation.capsule(height=0.62 * height, radius=radius, count=[12, 12])
    torso.apply_translation([0.0, 0.0, 0.12 * height])
    head = trimesh.creation.icosphere(subdivisions=2, radius=0.07 * height)
    head.apply_translation([0.0, 0.0, 0.93 * height])
    colours = np.concatenate(
        [
            np.broadcast_to(rng.uniform(0.05, 0.95, size=3), (len(torso.faces), 3)),
            np.broadcast_to(SKIN_RGB[rng.integers(4)], (len(head.faces), 3)),
        ]
    )
    merged = trimesh.util.concatenate([torso, head])
    part = replace(plain_part("person", merged.vertices, merged.faces), rgb=colours)
    return textured(part, rng, float(rng.uniform(0.05, 0.4)), 0.5 * height, recolour=False)
