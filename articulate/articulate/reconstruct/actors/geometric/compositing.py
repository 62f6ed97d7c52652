"""Crops of the video, rendered parts over a static background, and the light on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from articulate.reconstruct.actors.geometric.kernels import (
    LIGHT_ROWS,
    Floats,
    face_colours,
    face_views,
    render_over,
    sweep_costs,
    transform_points,
)
from articulate.reconstruct.actors.geometric.parameters import COMPOSITING, IMAGE, LIGHT
from articulate.reconstruct.actors.geometric.surface import PartSurface
from articulate.reconstruct.actors.protocol import Pixels
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.raster import fill
from articulate.transforms import Array, Ints, apply, axis_angle_to_matrix, normalised, pose


@dataclass(frozen=True, eq=False)
class Crop:
    """Frames of a video, cropped and resized."""

    frames: Floats
    """Colours (T, H, W, 3), 0 to 255."""
    indices: Ints
    """Indices of these frames in the video (T,)."""
    pinhole: Array
    """fx, fy, cx, cy [px]."""
    T_co: Array
    """Object frame to camera frame (4, 4)."""

    @property
    def size(self) -> tuple[int, int]:
        """Height and width [px]."""
        return self.frames.shape[1], self.frames.shape[2]

    def pixel_m(self, point_o: Array) -> float:
        """Return the size of a pixel at a point of the object (3,) [m]."""
        depth = float((self.T_co[:3, :3] @ point_o + self.T_co[:3, 3])[2])
        return max(depth, 0.05) / float(self.pinhole[0])

    def project(self, points_o: Array) -> Array:
        """Return the pixels (N, 2) [px] of points of the object (N, 3) [m]."""
        points_c = points_o @ self.T_co[:3, :3].T + self.T_co[:3, 3]
        depth = np.maximum(points_c[:, 2:], 1e-6)
        return np.asarray(points_c[:, :2] / depth * self.pinhole[:2] + self.pinhole[2:])


def crop_video(
    video: Pixels, camera: Camera, indices: Ints, box: tuple[int, int, int, int], max_px: int
) -> Crop:
    """Crop some frames of a video to a region and resize it.

    Args:
        video: Frames (T, H, W, 3), 0 to 255.
        camera: Camera of the full frames.
        indices: Indices of the frames (K,).
        box: First column, column after the last, first row, row after the last [px].
        max_px: Longest side of the crop [px].
    """
    left, right, top, bottom = box
    width, height = right - left, bottom - top
    factor = min(IMAGE.max_enlargement, max_px / max(width, height))
    how = cv2.INTER_AREA if factor <= 1.0 else cv2.INTER_LINEAR
    new_w, new_h = max(8, round(width * factor)), max(8, round(height * factor))
    sx, sy = new_w / width, new_h / height
    frames = np.empty((len(indices), new_h, new_w, 3), dtype=np.float32)
    for k, index in enumerate(indices):
        piece = np.ascontiguousarray(video[index, top:bottom, left:right])
        frames[k] = cv2.resize(piece, (new_w, new_h), interpolation=how)
    pinhole = np.array(
        [
            camera.fx_px * sx,
            camera.fy_px * sy,
            (camera.cx_px - left + 0.5) * sx - 0.5,
            (camera.cy_px - top + 0.5) * sy - 0.5,
        ]
    )
    return Crop(frames, np.asarray(indices), pinhole, camera.T_cw)


def change_map(video: Pixels) -> NDArray[np.bool_]:
    """Return the pixels that change in a video (T, H, W, 3), a boolean mask (H, W).

    A pixel changes if, after a slight blur, two frames differ in it by more than frames do in
    static pixels; at least a fifth of the image is assumed to be static.
    """
    picks = np.unique(np.linspace(0, len(video) - 1, min(len(video), 24)).round().astype(int))
    soft = np.stack([cv2.GaussianBlur(video[k], (0, 0), 0.8) for k in picks])
    spread = (soft.max(axis=0) - soft.min(axis=0)).max(axis=-1)
    low, noise = np.percentile(spread, (2, 20))
    changed = spread > noise + 4.0 * (noise - low) + IMAGE.min_change
    count, labels, stats, _ = cv2.connectedComponentsWithStats(changed.astype(np.uint8))
    small = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] < IMAGE.speck_px]
    return np.asarray(changed & ~np.isin(labels, small))


def perturb_camera(T_co: Array, middle_o: Array, x: Array) -> Array:
    """Return the camera pose ``T_co`` (4, 4) after a camera offset ``x`` (6,) [rad, tangent, log].

    The object at ``middle_o`` (3,) [m] seems to rotate, shift and recede.
    """
    turn = float(np.linalg.norm(x[:3]))
    R = T_co[:3, :3]
    if turn > 0.0:
        R = axis_angle_to_matrix(x[:3] / turn, turn) @ R
    middle_c = apply(T_co, middle_o)
    depth = middle_c[2] * np.exp(x[5])
    middle_c = np.array([*(middle_c[:2] / middle_c[2] + x[3:5]), 1.0]) * depth
    return pose(middle_c - R @ middle_o, R)


def object_box(camera: Camera, parts: Sequence[PartMesh]) -> tuple[int, int, int, int]:
    """Return the object's region: first and end column, first and end row [px]."""
    low, high = joint_bounds(parts)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    uv, _ = camera.project(low + corners * (high - low))
    full_frame = (0, camera.width_px, 0, camera.height_px)
    if not np.isfinite(uv).all():
        return full_frame
    margin = 0.15 * float(np.ptp(uv, axis=0).max()) + 4.0
    first = np.floor(uv.min(axis=0) - margin).astype(int)
    last = np.ceil(uv.max(axis=0) + margin).astype(int) + 1
    left, top = max(0, int(first[0])), max(0, int(first[1]))
    right, bottom = min(camera.width_px, int(last[0])), min(camera.height_px, int(last[1]))
    return (left, right, top, bottom) if right - left >= 8 and bottom - top >= 8 else full_frame


@dataclass(frozen=True, eq=False)
class Compositing:
    """A crop in which some parts move before a static background."""

    crop: Crop
    moving: PartSurface
    """The moving parts, at position 0."""
    light: Array
    """Light (LIGHT_ROWS, 3)."""
    nearness: Floats
    """Inverse depth of the static parts (H, W) [1/m]."""
    still: Floats
    """Image of the static parts and background (H, W, 3), 0 to 255."""
    base: Floats
    """Cost of each pixel without the moving parts (T, H, W)."""

    def costs(self, T_o: Array) -> Array:
        """Return the cost of every frame for every pose (Q, T).

        Args:
            T_o: Poses of the moving parts (Q, 4, 4), homogeneous.
        """
        out = np.empty((len(T_o), len(self.crop.frames)))
        return self._swept(T_o, out, diagonal=False) + self.still_costs

    def path_cost(self, T_o: Array) -> Array:
        """Return the cost of each frame (T,) with its own pose ``T_o`` (T, 4, 4), homogeneous."""
        out = np.empty((len(self.crop.frames), 1))
        return self._swept(T_o, out, diagonal=True)[:, 0] + self.still_costs

    @cached_property
    def still_costs(self) -> Array:
        """Cost of each frame without the moving parts (T,)."""
        return np.asarray(self.base.sum(axis=(1, 2), dtype=np.float64))

    @cached_property
    def own_px(self) -> int:
        """Number of pixels of the moving parts at position 0, occlusion ignored."""
        return int(self._own.sum())

    @cached_property
    def thickness_px(self) -> float:
        """Mean thickness of the moving parts in the image [px], two at least.

        The width of a strip with the same mean distance from its edges.
        """
        if not self._own.any():
            return COMPOSITING.min_thickness_px
        if self._own.all():  # no edge is in the image
            return float(max(self._own.shape))
        depth_px = cv2.distanceTransform(self._own.astype(np.uint8), cv2.DIST_L2, 3)
        # In a strip of w pixels it is w / 4 on average, plus half a pixel to pixel centres.
        return max(COMPOSITING.min_thickness_px, 4.0 * float(depth_px[self._own].mean()) - 2.0)

    @cached_property
    def _own(self) -> NDArray[np.bool_]:
        """Mask of the moving parts at position 0 (H, W), occlusion ignored."""
        return np.asarray(rasterize(self.moving, self.crop).face_ids >= 0)

    @cached_property
    def _by_pixel(self) -> tuple[Floats, Floats]:
        """Frames (H, W, 3, T) and base costs (H, W, T) in the layout of the compiled loops."""
        frames = np.ascontiguousarray(self.crop.frames.transpose(1, 2, 3, 0))
        return frames, np.ascontiguousarray(self.base.transpose(1, 2, 0))

    def _swept(self, T_o: Array, out: Array, *, diagonal: bool) -> Array:
        frames, base = self._by_pixel
        sweep_costs(
            (self.moving.points_o, self.moving.faces, self.moving.albedo),
            self.light,
            np.ascontiguousarray(self.crop.T_co @ T_o),
            self.crop.pinhole,
            self.nearness,
            frames,
            base,
            diagonal,
            np.float32(COMPOSITING.pixel_cost_cap),
            out,
        )
        return out


@dataclass(frozen=True, eq=False)
class RasterizedSurface:
    """A surface as seen by the camera of a crop."""

    nearness: Floats
    """Inverse depth (H, W) [1/m], 0 for background."""
    face_ids: NDArray[np.int32]
    """Face of each pixel (H, W), -1 for background."""
    points_c: Array
    """Vertices in the camera frame (V, 3) [m]."""


def absolute_sum(off: Floats) -> Floats:
    """Return the sum (...) of absolute differences of three colours (..., 3), 0 to 765."""
    size = np.abs(off)
    return np.asarray(size[..., 0] + size[..., 1] + size[..., 2])  # much faster than sum()


def rasterize(surface: PartSurface, crop: Crop, T_o: Array | None = None) -> RasterizedSurface:
    """Rasterize ``surface``, moved by ``T_o`` (4, 4, homogeneous), for the camera of ``crop``."""
    nearness = np.zeros(crop.size, dtype=np.float32)
    face_ids = np.full(crop.size, -1, dtype=np.int32)
    points_c = np.empty_like(surface.points_o)
    T_co = crop.T_co if T_o is None else crop.T_co @ T_o
    transform_points(surface.points_o, np.ascontiguousarray(T_co), points_c)
    enabled = np.ones(len(surface.faces), dtype=np.bool_)
    fill(points_c, surface.faces, enabled, crop.pinhole, nearness, face_ids)
    return RasterizedSurface(nearness, face_ids, points_c)


def build_compositing(
    crop: Crop,
    everything: PartSurface,
    moving_ids: Sequence[int],
    light: Array,
    change: NDArray[np.bool_],
) -> Compositing:
    """Separate the parts ``moving_ids`` of ``everything`` from the static background of a crop.

    A static pixel has its colour in the frame that matches the model best, since moving parts may
    cover it in the others; but it differs from the model by little more than pixels that never
    change.

    Args:
        crop: The frames.
        everything: All parts, joints at 0.
        moving_ids: Indices of the moving parts.
        light: Light (LIGHT_ROWS, 3).
        change: Mask of the pixels that change (H, W).
    """
    moving = everything.only(moving_ids)
    rest = everything.only(sorted(set(np.unique(everything.part_ids)) - set(moving_ids)))
    seen = rasterize(rest, crop)
    solid = seen.face_ids >= 0
    model = plain_behind(crop, solid, change)
    if solid.any():
        colours = face_colours(seen.points_c, rest.faces, rest.albedo, light)
        model[solid] = colours[seen.face_ids[solid]]
    off = absolute_sum(crop.frames - model)
    nearest = off.argmin(axis=0)
    rows, columns = np.indices(crop.size)
    best = crop.frames[nearest, rows, columns]
    calm = ~change if (~change).sum() > 50 else np.ones_like(change)
    slack = (
        COMPOSITING.slack_ratio * float(np.median(np.abs(best - model)[calm]))
        + COMPOSITING.min_slack
    )
    still = np.where(calm[..., None], best, model + np.clip(best - model, -slack, slack))
    doubt = COMPOSITING.mismatch_weight * np.minimum(
        absolute_sum(still - model), COMPOSITING.pixel_cost_cap
    )
    base = np.minimum(absolute_sum(crop.frames - still), COMPOSITING.pixel_cost_cap) + doubt
    return Compositing(
        crop, moving, light, seen.nearness, still.astype(np.float32), base.astype(np.float32)
    )


def model_image(T_o: Array, layers: Compositing) -> Floats:
    """Return the expected image (H, W, 3) with the moving parts at ``T_o`` (4, 4) [m]."""
    image = layers.still.copy()
    visible = np.zeros(layers.crop.size, dtype=np.bool_)
    surface = layers.moving
    render_over(
        (surface.points_o, surface.faces, surface.albedo),
        layers.light,
        np.ascontiguousarray(layers.crop.T_co @ T_o),
        layers.crop.pinhole,
        layers.nearness,
        image,
        visible,
    )
    return image


def plain_behind(crop: Crop, solid: NDArray[np.bool_], change: NDArray[np.bool_]) -> Floats:
    """Return the background colour (H, W, 3), extrapolated to where the object hides it.

    Args:
        crop: The frames.
        solid: Mask of the object (H, W).
        change: Mask of the pixels that change (H, W).
    """
    middle = np.median(crop.frames, axis=0)
    near_solid = cv2.dilate(solid.astype(np.uint8), np.ones((5, 5))).astype(np.bool_)
    known = ~near_solid & ~change
    if known.sum() < 20:
        known = ~solid
    if known.sum() < 20:
        return np.full((*crop.size, 3), 255.0, dtype=np.float32)
    return spread_behind(middle, known)


def spread_behind(colours: Floats, known: NDArray[np.bool_]) -> Floats:
    """Return ``colours`` (H, W, 3) where ``known`` (H, W, boolean), and nearby ones elsewhere."""
    weight = known.astype(np.float32)
    summed = np.zeros(colours.shape, dtype=np.float32)
    amount = np.zeros(known.shape, dtype=np.float32)
    for sigma, share in ((2.0, 1.0), (8.0, 1e-3), (40.0, 1e-6)):
        blurred = cv2.GaussianBlur(colours.astype(np.float32) * weight[..., None], (0, 0), sigma)
        summed += share * blurred
        amount += share * cv2.GaussianBlur(weight, (0, 0), sigma)
    mean = colours[known].mean(axis=0)
    return np.asarray((summed + 1e-12 * mean) / (amount + 1e-12)[..., None], dtype=np.float32)


def plain_light() -> Array:
    """Return the prior of the light (LIGHT_ROWS, 3)."""
    light = np.zeros((LIGHT_ROWS, 3))
    light[:3] = np.array(LIGHT.prior_strengths)[:, None]
    light[3] = normalised([0.3, -0.8, -0.5])
    return light


def fit_light(crop: Crop, everything: PartSurface, change: NDArray[np.bool_]) -> Array:
    """Estimate the light on the object (LIGHT_ROWS, 3) from static pixels, if any.

    Args:
        crop: The frames.
        everything: All parts, joints at 0.
        change: Mask of the pixels that change (H, W).
    """
    views, albedo, colours = still_samples(crop, everything, change)
    if len(views) < LIGHT.min_pixels:
        return _light_at_rest(crop, everything)
    return solve_light(views, albedo, colours)


def _light_at_rest(crop: Crop, everything: PartSurface) -> Array:
    """Return the light of the frame that matches the object with all joints at 0 best.

    A door that sweeps over all of a cabinet leaves no static pixel, and under the prior light
    hiding the door costs less than seeing it. If no frame matches well, the prior is returned.
    """
    nowhere = np.zeros(crop.size, dtype=np.bool_)
    best, best_cost = plain_light(), LIGHT.max_rest_residual
    for t in np.unique(np.linspace(0, len(crop.frames) - 1, LIGHT.rest_frames).round().astype(int)):
        one = replace(crop, frames=crop.frames[t : t + 1], indices=crop.indices[t : t + 1])
        views, albedo, colours = still_samples(one, everything, nowhere)
        light = solve_light(views, albedo, colours)
        lamp = np.maximum(views[:, :3] @ light[3], 0.0)[:, None]
        shade = light[0] + light[1] * views[:, 3:] + light[2] * lamp
        off = np.abs(albedo * shade - colours) / 255.0
        cost = (
            float(np.minimum(off, 5.0 * LIGHT.soft_residual).mean())
            if len(views) >= LIGHT.min_pixels
            else np.inf
        )
        if cost < best_cost:
            best, best_cost = light, cost
    return best


def still_samples(
    crop: Crop, surface: PartSurface, change: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Return face views (N, 4), albedo (N, 3) and colours (N, 3) of static pixels.

    Args:
        crop: The frames.
        surface: Triangles with albedo.
        change: Mask of the pixels that change (H, W).
    """
    seen = rasterize(surface, crop)
    inside = cv2.erode((seen.face_ids >= 0).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
    mask = inside & ~change
    ids = seen.face_ids[mask]
    views = face_views(seen.points_c, surface.faces)[ids]
    colours = np.median(crop.frames, axis=0)[mask].astype(np.float64)
    return np.asarray(views), surface.albedo[ids], colours


def solve_light(views: Array, albedo: Array, colours: Array) -> Array:
    """Return the light (LIGHT_ROWS, 3) under which faces have the observed colours.

    Args:
        views: Unit normal and cosine to the camera (N, 4).
        albedo: Albedo (N, 3), 0 to 255.
        colours: Observed colours (N, 3), 0 to 255.
    """
    if len(views) < LIGHT.min_pixels:
        return plain_light()
    chosen = np.linspace(0, len(views) - 1, min(LIGHT.max_pixels, len(views))).round().astype(int)
    views, albedo, colours = views[chosen], albedo[chosen] / 255.0, colours[chosen] / 255.0
    best, best_cost = plain_light()[3], np.inf
    for directions in (_sphere(90), None):
        if directions is None:
            directions = normalised(best + 0.25 * _sphere(30))
        costs = _first_costs(views, albedo, colours, directions)
        nearest = int(costs.argmin())
        if costs[nearest] < best_cost:
            best, best_cost = directions[nearest], costs[nearest]
    light = np.empty((LIGHT_ROWS, 3))
    light[:3] = _strengths(views, albedo, colours, best, rounds=4)[:, None]
    light[3] = best
    return light


def _first_costs(views: Array, albedo: Array, colours: Array, directions: Array) -> Array:
    """Return the robust cost (D,) of the least-squares strengths for each direction (D, 3)."""
    lamps = np.maximum(views[:, :3] @ directions.T, 0.0)
    terms = np.empty((len(directions), 3, len(views)))
    terms[:, 0], terms[:, 1], terms[:, 2] = 1.0, views[:, 3], lamps.T
    pull = _pull(albedo)
    normals = (terms * (albedo**2).sum(axis=1)) @ terms.transpose(0, 2, 1) + np.eye(3) * pull
    forces = terms @ (albedo * colours).sum(axis=1) + np.array(LIGHT.prior_strengths) * pull
    strengths = [_nonnegative_solution(*pair) for pair in zip(normals, forces, strict=True)]
    shades = (np.array(strengths)[:, None] @ terms)[:, 0]
    costs = np.zeros(len(directions))
    for c in range(3):
        costs += np.minimum(
            np.abs(albedo[:, c] * shades - colours[:, c]), 5 * LIGHT.soft_residual
        ).sum(axis=1)
    return costs


def _strengths(
    views: Array, albedo: Array, colours: Array, direction: Array, *, rounds: int
) -> Array:
    """Return ambient, camera and lamp strength (3,) of least absolute residuals."""
    lamp = np.maximum(views[:, :3] @ direction, 0.0)
    terms = np.stack([np.ones(len(views)), views[:, 3], lamp], axis=1)
    rows = (albedo[:, :, None] * terms[:, None, :]).reshape(-1, 3)
    target = colours.reshape(-1)
    pull, weight = _pull(albedo), np.ones(len(rows))
    for _ in range(rounds):
        scaled = rows * weight[:, None]
        normal, force = scaled.T @ rows + np.eye(3) * pull, scaled.T @ target
        strength = _nonnegative_solution(normal, force + np.array(LIGHT.prior_strengths) * pull)
        weight = LIGHT.soft_residual / np.maximum(
            np.abs(rows @ strength - target), LIGHT.soft_residual
        )
    return strength


def _pull(albedo: Array) -> float:
    """Return the weight of the prior; black surfaces leave only the prior."""
    return float(LIGHT.prior_weight * (albedo**2).sum() + np.finfo(np.float64).eps)


def _nonnegative_solution(normal: Array, force: Array) -> Array:
    """Return the ``x`` >= 0 (3,) that minimizes ``x normal x - 2 force x``."""
    root = np.linalg.cholesky(normal)
    return np.asarray(nnls(root.T, np.linalg.solve(root, force))[0])


def _sphere(n: int) -> Array:
    """Return ``n`` directions spread evenly over the sphere (n, 3) (Fibonacci lattice)."""
    k = np.arange(n) + 0.5
    height = 1.0 - 2.0 * k / n
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
