"""Rendered training images of the procedural library for the networks that read photos.

    python benchmarks/photo_samples.py --images 13500 --out FOLDER

Objects have seeds below 1000, or random fronts; sizes are scaled along each axis, colours and
textures are random. A sample holds inner features of the ImageNet network: of the square around the
object with the corners of its box, and of the rectified front with the rectangles of its parts.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.random import Generator

from articulate.errors import ConfigError
from articulate.library.procedural.categories import CATEGORIES
from articulate.library.procedural.front_layout import FrontLayout, FrontPanel
from articulate.library.procedural.materials import PALETTE
from articulate.library.procedural.urdf import Part
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.fitting.box_network import CORNERS, square_crop
from articulate.reconstruct.fitting.front_network import KINDS, front_square
from articulate.reconstruct.images import only_joint, poses_at
from articulate.reconstruct.make_object import part_meshes, predicted_joints
from articulate.reconstruct.proposal import ObjectProposal
from articulate.reconstruct.recognition.classifier import SIDE_PX, feature_maps
from articulate.render.camera import Camera, look_at, pinhole
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.raster import Pixels
from articulate.render.rendered_photo import (
    AZIMUTH_DEG,
    ELEVATION_DEG,
    FILL,
    FOCAL_MM,
    background,
)
from articulate.render.scene import NO_PART, Light, PartScene
from articulate.transforms import Array

SEEDS = (1, 1000)
FURNITURE_SHARE = 0.35
"""Share of random fronts among the objects."""
SCALE_SPREAD = 0.2
"""Spread of the logarithm of the scale along each axis."""
LONG_PX, SHORT_PX = 352, 264
"""Sides of the rendered images [px]."""
VIEWS = 2
CHUNK = 250
FRONT_ERROR = 0.045
"""Largest spread of the corners of a rectified front, as a share of its side."""
MOST_PARTS = 24
BOX_MAPS = ("stride_16", "stride_32")
"""Inner features that the network for the box reads."""
"""Samples in a file."""
FRONTS = (
    "cabinet",
    "chest_of_drawers",
    "table_with_drawers",
    "fridge",
    "microwave",
    "oven",
    "dishwasher",
    "washing_machine",
    "safe",
)
"""Categories with a front that is divided."""


@dataclass(frozen=True, kw_only=True)
class TrainingObject:
    """Object with the parts at its front."""

    name: str
    meshes: tuple[PartMesh, ...]
    fronts: Mapping[int, int]
    """Kind of each drawer, door and flap, as an index of ``front_network.KINDS``, by its mesh."""


def split(rng: Generator, area: tuple[float, float, float, float], depth: int) -> list[Array]:
    """Divide an area (left, right, bottom, top) recursively into rectangles (4,)."""
    left, right, bottom, top = area
    if depth == 0 or rng.uniform() < (0.05, 0.45, 0.75)[min(depth, 3) - 1]:
        return [np.array(area)]
    level = rng.uniform() < 0.6
    n = int(rng.choice([2, 3, 4, 5], p=[0.55, 0.25, 0.15, 0.05]))
    weights = np.ones(n) if rng.uniform() < 0.5 else rng.uniform(0.5, 2.0, size=n)
    cuts = np.concatenate([[0.0], np.cumsum(weights / weights.sum())])
    same = rng.uniform() < 0.4
    out: list[Array] = []
    for k in range(n):
        a, b = float(cuts[k]), float(cuts[k + 1])
        part = (
            (left, right, bottom + a * (top - bottom), bottom + b * (top - bottom))
            if level
            else (left + a * (right - left), left + b * (right - left), bottom, top)
        )
        out += [np.array(part)] if same else split(rng, part, depth - 1)
    return out


def furniture(rng: Generator) -> tuple[Part, ...]:
    """Return furniture with a random front."""
    while True:
        height = float(rng.uniform(0.4, 2.0))
        width = height * float(np.exp(rng.uniform(np.log(0.35), np.log(2.6))))
        depth = height * float(np.exp(rng.uniform(np.log(0.25), np.log(1.2))))
        base = str(rng.choice(["plinth", "legs", "none"]))
        base_m = height * float(rng.choice([rng.uniform(0.03, 0.2), rng.uniform(0.2, 0.6)]))
        panels, aspect = [], width / height
        handle = str(rng.choice(["bar", "bar", "knob", "none"]))
        for left, right, bottom, top in split(rng, (0.0, 1.0, 0.0, 1.0), 3):
            wide = aspect * (right - left) / (top - bottom)
            drawer = rng.uniform() < 1.0 / (1.0 + (1.2 / wide) ** 2.5)
            kind = "drawer" if drawer else "flap" if rng.uniform() < 0.08 * wide else "door"
            if rng.uniform() < 0.2:
                kind = str(rng.choice(["panel", "open", "gap"]))
            hinge = {"door": ("left", "right"), "flap": ("top", "bottom")}.get(kind, ("",))
            panels.append(
                FrontPanel(
                    kind=kind,  # type: ignore[arg-type]
                    left=left,
                    right=right,
                    bottom=bottom,
                    top=top,
                    hinge=str(rng.choice(hinge)),  # type: ignore[arg-type]
                    handle=handle,  # type: ignore[arg-type]
                )
            )
        try:
            layout = FrontLayout(
                panels=tuple(panels),
                width_m=width,
                depth_m=depth,
                height_m=height,
                base=base,  # type: ignore[arg-type]
                base_m={"none": 0.0, "plinth": 0.1 * height, "legs": base_m}[base],
                worktop_m=float(rng.choice([0.0, 0.018, 0.03])),
                handle_m=float(rng.uniform(0.08, 0.6)),
            )
            return tuple(layout.parts())
        except (ConfigError, ValueError):
            continue


def sample_object(rng: Generator) -> TrainingObject:
    """Sample an object, its sizes and its colours; its front is at +x."""
    if rng.uniform() < FURNITURE_SHARE:
        name, parts, palette = "furniture", furniture(rng), dict(PALETTE)
    else:
        names = [*CATEGORIES, *FRONTS]
        name = names[int(rng.integers(len(names)))]
        parts = tuple(CATEGORIES[name].parts(int(rng.integers(*SEEDS))))
        palette = dict(CATEGORIES[name].palette)
    if rng.uniform() < 0.6:
        darkest = float(rng.choice([0.04, 0.35]))
        tints = {key: rng.uniform(darkest, 1.0) * rng.uniform(0.7, 1.0, size=3) for key in palette}
        palette = {
            key: replace(one, rgba=(*map(float, tints[key]), 1.0))  # type: ignore[arg-type]
            for key, one in palette.items()
        }
    scale = np.exp(rng.normal(size=3) * SCALE_SPREAD) * [-1.0, -1.0, 1.0]
    meshes = list(part_meshes(parts, palette))
    proposal = ObjectProposal(name=name, category="", parts=parts, confidence=1.0, evidence={})
    joints = {joint.part: joint for joint in predicted_joints(proposal)}
    fronts = {
        k: front_kind(joints[part.name], mesh)
        for k, (part, mesh) in enumerate(zip(parts, meshes, strict=True))
        if any(word in part.name for word in ("drawer", "door", "flap"))
    }
    if name == "laptop" or (name not in FRONTS and name != "furniture" and rng.uniform() < 0.3):
        moved = list(joints)[int(rng.integers(len(joints)))]
        poses = poses_at(meshes, only_joint(joints, moved), float(rng.uniform(0.2, 1.0)))
        meshes = [mesh.moved(T) for mesh, T in zip(meshes, poses, strict=True)]
    meshes = [mesh.with_vertices(mesh.vertices * scale) for mesh in meshes]
    low, high = joint_bounds(meshes)
    shift = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]]
    meshes = [mesh.with_vertices(mesh.vertices - shift) for mesh in meshes]
    return TrainingObject(name=name, meshes=tuple(meshes), fronts=fronts)


def front_kind(joint: PredictedJoint, mesh: PartMesh) -> int:
    """Return the kind of a front, an index of ``KINDS``, from its joint; the front is at -x."""
    if joint.kind == "prismatic":
        return KINDS.index("drawer")
    if abs(joint.axis_o[2]) < max(abs(joint.axis_o[0]), abs(joint.axis_o[1])):
        return KINDS.index("flap")
    left = joint.pivot_o[1] > mesh.bounds[:, 1].mean()
    return KINDS.index("door_left" if left else "door_right")


def front_rectangle(mesh: PartMesh) -> Array:
    """Return the corners (4, 3) of a part's front, from top left clockwise, front at +x."""
    tri = mesh.vertices[mesh.faces]
    normal = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    flat = np.abs(normal[:, 0]) > 0.9 * np.linalg.norm(normal, axis=1)
    x = mesh.bounds[1, 0]
    if flat.any():
        at = np.round(tri[flat][:, :, 0].mean(axis=1), 3)
        planes = {v: float(np.abs(normal[flat][at == v, 0]).sum()) for v in np.unique(at)}
        most = max(planes.values())
        x = max(v for v, area in planes.items() if area > 0.5 * most)
    (_, y0, z0), (_, y1, z1) = mesh.bounds
    return np.array([[x, y0, z1], [x, y1, z1], [x, y1, z0], [x, y0, z0]])


def box_of(meshes: Sequence[PartMesh]) -> tuple[Array, Array]:
    """Return the corners of the box (8, 3), in the order of ``CORNERS``, and its sides (3,)."""
    low, high = joint_bounds(list(meshes))
    return 0.5 * (low + high) + 0.5 * CORNERS * (high - low), high - low


def front_corners(corners: Array, camera: Camera) -> Array:
    """Return the corners of the front in the image (4, 2) [px]; corners as in ``box_of``."""
    uv, _ = camera.project(corners[[5, 7, 6, 4]])  # top left, top right, bottom right, bottom left
    return np.asarray(uv)


def texture(rng: Generator, boxes: Array) -> Array:
    """Return factors (S, S, 3) of the colours of a front: grain, frames and dark windows."""
    out = np.ones((SIDE_PX, SIDE_PX, 3), dtype=np.float32)
    if rng.uniform() < 0.6:
        size = [(6, 60), (60, 6), (24, 24), (4, 12)][int(rng.integers(4))]
        noise = rng.normal(size=size).astype(np.float32)
        grain = cv2.resize(noise, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_CUBIC)
        out *= 1.0 + rng.uniform(0.02, 0.15) * grain[..., None]
    if rng.uniform() < 0.35:
        inset, shade = rng.uniform(0.08, 0.25), rng.uniform(0.4, 1.4)
        fill = rng.uniform() < 0.4
        for left, top, right, bottom in boxes:
            if min(right - left, bottom - top) < 14 or rng.uniform() < 0.15:
                continue
            gap = inset * min(right - left, bottom - top)
            first = (int(left + gap), int(top + gap))
            second = (int(right - gap), int(bottom - gap))
            cv2.rectangle(out, first, second, (shade,) * 3, -1 if fill else int(rng.integers(1, 3)))
    return np.asarray(out, dtype=np.float64)


def render(one: TrainingObject, rng: Generator) -> dict[str, Array] | None:
    """Render one view and return its sample."""
    camera = training_camera(one.meshes, rng)
    direction = (rng.uniform(-1.0, 0.2), rng.uniform(-1.0, 1.0), rng.uniform(-1.5, -0.5))
    light = Light(
        direction_w=direction, ambient=rng.uniform(0.35, 0.55), directional=rng.uniform(0.2, 0.5)
    )
    scene = PartScene(one.meshes, light)
    part_ids = scene.rasterize(camera).part_ids
    image: Array = scene.render_image(camera, samples=2).astype(np.float32)
    mask = part_ids != NO_PART
    if mask.mean() < 0.01:
        return None
    corners, sides = box_of(one.meshes)
    front_px = front_corners(corners, camera)
    has_front = one.name == "furniture" or one.name in FRONTS
    if has_front:
        _, H = front_square(image.astype(np.uint8), front_px)
        size = (camera.width_px, camera.height_px)
        factor = cv2.warpPerspective(
            texture(rng, part_boxes(one, camera, H)),
            np.linalg.inv(H),
            size,
            borderValue=(1, 1, 1),
        )
        factor[factor == 0.0] = 1.0
        image *= factor
    behind = background(camera, rng)
    image = np.asarray(np.where(mask[..., None], image, behind), dtype=np.float64)
    image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 0.8)).astype(np.float64)
    image += rng.normal(size=image.shape) * rng.uniform(0.5, 4.0)
    photo = np.clip(image, 0, 255).astype(np.uint8)
    if rng.uniform() < 0.25:
        photo = _with_arm(photo, mask, rng)
    sample = _sample(one, photo, mask, camera, corners, sides, rng)
    if has_front:
        sample |= _front_sample(one, photo, camera, front_px, float(sides[1] / sides[2]), rng)
    return sample


def part_boxes(one: TrainingObject, camera: Camera, H: Array) -> Array:
    """Return left, top, right and bottom (N, 4) [px] of the parts in the square of the front."""
    flat = []
    for k in one.fronts:
        uv, _ = camera.project(front_rectangle(one.meshes[k]))
        flat.append(cv2.perspectiveTransform(uv[None].astype(np.float32), H)[0])
    return np.array([[*f.min(axis=0), *f.max(axis=0)] for f in flat]).reshape(-1, 4)


def _front_sample(
    one: TrainingObject,
    photo: Pixels,
    camera: Camera,
    front_px: Array,
    aspect: float,
    rng: Generator,
) -> dict[str, Array]:
    """Return the features of a front that is rectified with an error, and its parts.

    Parts are left, top, right and bottom in shares of the square, and the kind (``MOST_PARTS``, 5).
    """
    side = float(np.sqrt(cv2.contourArea(front_px.astype(np.float32))))
    error = float(rng.uniform(0.0, FRONT_ERROR)) * side
    square, H = front_square(photo, front_px + rng.normal(size=(4, 2)) * error)
    boxes = (part_boxes(one, camera, H) + 0.5) / SIDE_PX
    parts: Array = np.zeros((MOST_PARTS, 5))
    kept = min(len(boxes), MOST_PARTS)
    parts[:kept, :4] = boxes[:kept]
    parts[:kept, 4] = list(one.fronts.values())[:kept]
    maps = feature_maps([square])
    out: dict[str, Array] = {
        f"front_{name}": value[0].astype(np.float16) for name, value in maps.items()
    }
    out["front_parts"] = parts.astype(np.float32)
    out["front_aspect"] = np.array(np.log(aspect) + 0.1 * rng.normal(), dtype=np.float32)
    return out


def training_camera(meshes: Sequence[PartMesh], rng: Generator) -> Camera:
    """Sample a camera like that of ``render_photo``, at a lower resolution."""
    low, high = joint_bounds(list(meshes))
    azimuth, elevation = (
        np.radians(rng.uniform(*AZIMUTH_DEG)),
        np.radians(rng.uniform(*ELEVATION_DEG)),
    )
    upright = (high - low)[2] > 1.2 * (high - low)[1]
    width, height = (SHORT_PX, LONG_PX) if upright else (LONG_PX, SHORT_PX)
    focal_px = float(rng.uniform(*FOCAL_MM)) / 36.0 * LONG_PX
    target = 0.5 * (low + high) + 0.05 * rng.normal(size=3) * (high - low)
    towards = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    T = look_at(target + towards, target)
    corners = 0.5 * (low + high) + 0.5 * CORNERS * (high - low)
    across, depth = (corners - target) @ T[:3, :2], (corners - target) @ T[:3, 2]
    reach = np.abs(across) * focal_px / (0.5 * np.array([width, height]))
    distance = float((reach / rng.uniform(*FILL) - depth[:, None]).max())
    distance = max(distance, 0.1 - float(depth.min()))
    return pinhole(
        width_px=width,
        height_px=height,
        fovy_rad=float(2.0 * np.arctan(0.5 * height / focal_px)),
        T_wc=look_at(target + distance * towards, target),
    )


def _with_arm(image: Pixels, mask: Array, rng: Generator) -> Pixels:
    rows, columns = np.nonzero(mask)
    k = int(rng.integers(len(rows)))
    height, width = mask.shape
    start = (int(rng.choice([0, width - 1])), int(rng.uniform(0.3, 1.0) * height))
    colour = tuple(float(c) for c in np.array([200, 160, 130]) * rng.uniform(0.4, 1.1))
    thickness = int(rng.uniform(0.05, 0.11) * width)
    out = image.copy()
    cv2.line(out, start, (int(columns[k]), int(rows[k])), colour, thickness, cv2.LINE_AA)
    return out


def _sample(
    one: TrainingObject,
    photo: Pixels,
    mask: Array,
    camera: Camera,
    corners: Array,
    sides: Array,
    rng: Generator,
) -> dict[str, Array]:
    rows, columns = np.nonzero(mask)
    box = np.array([columns.min(), rows.min(), columns.max(), rows.max()], dtype=np.float64)
    size = np.tile(box[2:] - box[:2], 2)
    box += rng.normal(size=4) * 0.03 * size
    crop, T = square_crop(photo, box)
    uv, _ = camera.project(corners)
    maps = feature_maps([crop])
    centre = camera.T_wc[:3, 3] - np.array([0.0, 0.0, 0.5 * sides[2]])
    out: dict[str, Array] = {name: maps[name][0].astype(np.float16) for name in BOX_MAPS}
    out["corners"] = ((uv + 0.5) * T[0] + T[1:]).astype(np.float32)
    out["sizes"] = np.log(sides / sides[2])[[1, 0]].astype(np.float32)
    azimuth = np.arctan2(centre[1], centre[0])
    elevation = np.arcsin(centre[2] / np.linalg.norm(centre))
    focal = np.log(camera.fx_px * T[0])  # in sides of the crop
    out["view"] = np.array([azimuth, elevation, focal], dtype=np.float32)
    return out


def main() -> None:
    """Render samples into files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--images", type=int, default=3250)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    flags = parser.parse_args()
    flags.out.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Array]] = []
    count, number = 0, 0
    while count < flags.images:
        rng = np.random.default_rng([flags.seed, number])
        number += 1
        one = sample_object(rng)
        for _ in range(VIEWS):
            sample = render(one, rng)
            if sample is not None:
                rows.append({**sample, "object": np.array(number)})
        if len(rows) >= CHUNK:
            write(rows, flags.out / f"{flags.seed:02d}_{count:06d}.npz")
            count, rows = count + len(rows), []
            sys.stderr.write(f"{count} images of {number} objects\n")


def write(rows: list[dict[str, Array]], path: Path) -> None:
    """Write samples: one array for each entry; entries of fronts only for samples with one."""
    names = sorted(set().union(*rows))
    arrays: dict[str, Any] = {n: np.stack([r[n] for r in rows if n in r]) for n in names}
    arrays["front_object"] = np.array([r["object"] for r in rows if "front_parts" in r])
    np.savez(path, **arrays)


if __name__ == "__main__":
    main()
