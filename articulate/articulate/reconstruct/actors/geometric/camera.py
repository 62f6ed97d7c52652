"""Camera calibration: pose from static pixels, pose from the motion, and video stabilization.

The given camera is a little off, and a handheld one moves. Both are corrected by what is static:
the object at rest is rendered under cameras close to the given one and compared with the video, and
the image motion that most points share is removed.

A lid that sweeps over all of a laptop leaves nothing static. But the object is known and seen in
many frames: under the right camera, and with the right motion, the rendered images match each of
them. So the camera is optimized jointly with the positions of the part, for a few of the motions
that its shape suggests, by damped Gauss-Newton steps. Large errors count at first, on blurred
images: otherwise the gradient has no direction.

A camera offset ``x`` (6,) is a rotation vector about the object's centre [rad], a shift of its
image [tangent], and the change of the logarithm of its distance.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.compositing import (
    Crop,
    RasterizedSurface,
    absolute_sum,
    change_map,
    crop_video,
    fit_light,
    object_box,
    perturb_camera,
    plain_behind,
    rasterize,
    solve_light,
    spread_behind,
)
from articulate.reconstruct.actors.geometric.fit import attach_parts, frame_motions
from articulate.reconstruct.actors.geometric.image_pyramid import (
    PyramidLevel,
    VideoScene,
    build_scene,
)
from articulate.reconstruct.actors.geometric.kernels import Floats, face_colours, face_views
from articulate.reconstruct.actors.geometric.parameters import (
    CAMERA,
    COMPOSITING,
    IMAGE,
    JOINT_FIT,
    SEARCH,
    FitLevel,
)
from articulate.reconstruct.actors.geometric.parts import hidden_parts, rank_parts
from articulate.reconstruct.actors.geometric.search import MotionFit, coarse_fits
from articulate.reconstruct.actors.geometric.surface import JointMotion, PartSurface, build_surface
from articulate.reconstruct.actors.protocol import Evidence, Pixels, TraceStep
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, Ints, inverse
from articulate.video.moving_region import camera_motion
from articulate.video.tracks import Tracking, follow_points

CAMERA_STEPS = np.array(JOINT_FIT.camera_steps)
POSITION_STEPS = {"turn": JOINT_FIT.turn_step_rad, "slide": JOINT_FIT.slide_step_m}


@dataclass(frozen=True, eq=False)
class StaticView:
    """The static pixels of a video at one resolution."""

    crop: Crop
    """One frame: the median of all."""
    surface: PartSurface
    mask: NDArray[np.bool_]
    """Pixels that are compared (H, W), boolean."""
    behind: Floats
    """Background colours (H, W, 3), 0 to 255."""
    middle_o: Array
    """Centre of the object (3,) [m]."""

    def crop_from(self, x: Array) -> Crop:
        """Return the same frame under a camera offset ``x`` (6,)."""
        return replace(self.crop, T_co=perturb_camera(self.crop.T_co, self.middle_o, x))

    def residuals(self, x: Array, light: Array) -> Floats:
        """Return rendered minus observed colours (N, 3) of compared pixels at an offset ``x``."""
        crop = self.crop_from(x)
        seen = rasterize(self.surface, crop)
        solid = seen.face_ids >= 0
        model = self.behind.copy()
        colours = face_colours(seen.points_c, self.surface.faces, self.surface.albedo, light)
        model[solid] = colours[seen.face_ids[solid]]
        off = cv2.GaussianBlur(model - crop.frames[0], (0, 0), CAMERA.blur_px)
        return np.asarray(off[self.mask])

    def cost(self, x: Array, light: Array) -> float:
        """Return the mean over pixels of the absolute colour differences, each capped."""
        return _cost(self.residuals(x, light))


def _cost(residuals: Floats) -> float:
    return float(np.minimum(absolute_sum(residuals), COMPOSITING.pixel_cost_cap).mean())


def refine_camera(
    video: Pixels, camera: Camera, parts: Sequence[PartMesh], *, seed: int = 0
) -> tuple[Camera, float]:
    """Return the camera close to ``camera`` under which the static pixels match the video best.

    Args:
        video: Frames (T, H, W, 3), 0 to 255.
        camera: The nominal camera.
        parts: The object, all joints at 0.
        seed: Seed of the random cameras.

    Returns:
        The camera, and the share by which it lowers the differences; ``camera`` and 0 where no
        other is clearly better, or too little of the object is static.
    """
    still = _still(video, camera, parts, CAMERA.levels_px[0])
    inside = rasterize(still.surface, still.crop).face_ids >= 0
    if (inside & still.mask).sum() < CAMERA.min_pixels:
        return camera, 0.0
    rng = np.random.default_rng(seed)
    light = _light(still, np.zeros(6))
    tries = CAMERA_STEPS * rng.uniform(-1.5, 1.5, (CAMERA.random_cameras, 6))
    costs = [still.cost(x, light) for x in tries]
    starts = [np.zeros(6), *tries[np.argsort(costs)[: CAMERA.refined_cameras]]]
    found = [_lowest(still, x, CAMERA_STEPS) for x in starts]
    x = min(found, key=lambda item: item[1])[0]
    step = CAMERA_STEPS
    for max_px in CAMERA.levels_px[1:]:
        step = CAMERA.finer_step * step
        nearby = camera.at(inverse(perturb_camera(camera.T_cw, still.middle_o, x)))
        still = _still(video, camera, parts, max_px, seen_by=nearby)
        x, _ = _lowest(still, x, step)
    nominal = still.cost(np.zeros(6), _light(still, np.zeros(6)))
    here = still.cost(x, _light(still, x))
    gain = 1.0 - here / max(nominal, 1e-9)
    if gain < CAMERA.min_gain:
        return camera, 0.0
    return camera.at(inverse(perturb_camera(camera.T_cw, still.middle_o, x))), gain


def _light(still: StaticView, x: Array) -> Array:
    return fit_light(still.crop_from(x), still.surface, ~still.mask)


def _lowest(still: StaticView, x: Array, step: Array) -> tuple[Array, float]:
    """Return the camera offset of least cost close to ``x`` and its cost.

    Gauss-Newton with weights for absolute differences, with Levenberg-Marquardt damping. Slopes are
    finite differences over a tenth of ``step``, since images are not smooth.
    """
    light = _light(still, x)
    off = still.residuals(x, light)
    cost, damping = _cost(off), 0.1
    for _ in range(CAMERA.rounds):
        slopes = _slopes(still, x, CAMERA.slope_share * step, light) / CAMERA.slope_share
        size = absolute_sum(off)
        weight = np.repeat(
            (size < COMPOSITING.pixel_cost_cap) / np.maximum(size, JOINT_FIT.soft_residual), 3
        )
        normal = (slopes * weight) @ slopes.T
        force = (slopes * weight) @ off.ravel()
        diagonal = np.diag(np.diag(normal) + 1e-9 * np.trace(normal) + 1e-12)
        for _ in range(JOINT_FIT.damping_rounds):
            there = x - step * np.linalg.solve(normal + damping * diagonal, force)
            tried = still.residuals(there, light)
            if _cost(tried) < cost:
                x, off, cost, damping = there, tried, _cost(tried), 0.2 * damping
                break
            damping *= 6.0
        else:
            break
        light = _light(still, x)
        off = still.residuals(x, light)
        cost = _cost(off)
    return x, cost


def _slopes(still: StaticView, x: Array, step: Array, light: Array) -> Array:
    """Return half the change of the residuals (6, 3 N) between a step up and down."""
    rows = [still.residuals(x + dx, light) - still.residuals(x - dx, light) for dx in np.diag(step)]
    return 0.5 * np.stack(rows).astype(np.float64).reshape(len(rows), -1)


def _still(
    video: Pixels,
    camera: Camera,
    parts: Sequence[PartMesh],
    max_px: int,
    *,
    seen_by: Camera | None = None,
) -> StaticView:
    """Build the static view of the region around the object, at most ``max_px`` wide and high."""
    change = change_map(video)
    middle_frame = np.median(video[:: max(1, len(video) // 16)], axis=0)
    box = object_box(seen_by or camera, parts)
    image: Pixels = middle_frame.astype(np.uint8)[None]
    crop = crop_video(image, camera, np.array([0]), box, max_px)
    left, right, top, bottom = box
    height, width = crop.size
    moving = cv2.dilate(change.astype(np.uint8), np.ones((5, 5)))[top:bottom, left:right]
    piece = cv2.resize(moving.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    middle_o = joint_bounds(parts).mean(axis=0)
    surface = build_surface(parts, pixel_m=crop.pixel_m(middle_o))
    mask = np.asarray(piece < 0.1)
    near = crop if seen_by is None else replace(crop, T_co=seen_by.T_cw)
    solid = (rasterize(surface, near).face_ids >= 0).astype(np.uint8)
    room = 1 + round(
        max_px
        * (CAMERA.unsure_share if seen_by is None else CAMERA.finer_step**2 * CAMERA.unsure_share)
    )
    unsure = cv2.dilate(solid, np.ones((2 * room + 1, 2 * room + 1))) > 0
    return StaticView(crop, surface, mask, plain_behind(crop, unsure, ~mask), middle_o)


def stabilize(video: Pixels, box: tuple[int, int, int, int]) -> tuple[Pixels, float]:
    """Remove the motion of the camera from a video.

    The camera's motion is that of the surroundings of the object. Before a plain wall a moving
    camera cannot be distinguished from a moving object; there it is assumed to be static.

    Args:
        video: Frames (T, H, W, 3), 0 to 255.
        box: Region of the object: first column, column after the last, first row, row after the
            last [px].

    Returns:
        The video as seen from the first camera pose and the largest shift of an image corner [px];
        the same video and 0 where the camera seems to be static.
    """
    grey = cv2.cvtColor(np.ascontiguousarray(video[0]), cv2.COLOR_RGB2GRAY).astype(np.float32)
    slope = np.hypot(cv2.Sobel(grey, -1, 1, 0), cv2.Sobel(grey, -1, 0, 1)) / 4.0
    beside = np.ones(grey.shape, dtype=np.bool_)
    beside[box[2] : box[3], box[0] : box[1]] = False
    edges = beside & (slope > CAMERA.edge)
    if edges.sum() < CAMERA.min_pixels or _spread(video, edges) < CAMERA.min_spread:
        return video, 0.0
    tracks = follow_points(video, Tracking(most_points=600, spacing_px=8), beside)
    motion = camera_motion(tracks)
    height, width = video.shape[1:3]
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]], dtype=float)
    shifted = np.einsum("tij,nj->tni", motion, corners)
    shift = np.linalg.norm(shifted[..., :2] / shifted[..., 2:] - corners[:, :2], axis=-1)
    steady = np.empty_like(video)
    for frame, H, out in zip(video, motion, steady, strict=True):
        frame = np.ascontiguousarray(frame)
        out[:] = cv2.warpPerspective(frame, H, (width, height), borderMode=cv2.BORDER_REPLICATE)
    if _spread(steady, edges) > CAMERA.max_spread_ratio * _spread(video, edges):
        return video, 0.0
    return steady, float(shift.max())


def _spread(video: Pixels, where: NDArray[np.bool_]) -> float:
    """Return the median over pixels of their mean absolute deviation from the temporal median."""
    if not where.any():
        return 0.0
    values = video[:: max(1, len(video) // 16), where].astype(np.float32)
    return float(np.median(np.abs(values - np.median(values, axis=0)).mean(axis=(0, 2))))


def calibrate_evidence(evidence: Evidence) -> tuple[Evidence, tuple[TraceStep, ...]]:
    """Return ``evidence`` with stabilized video and refined camera, and a trace of both."""
    video, camera = evidence.video, evidence.camera
    known = bool(evidence.parts) and evidence.placed
    if video is None or camera is None or len(video) < 2 or not known:
        return evidence, ()
    start = time.monotonic()
    steady, shift_px = stabilize(video, object_box(camera, evidence.parts))
    still, gain = refine_camera(steady, camera, evidence.parts, seed=evidence.seed)
    scene, better, moving = build_scene(steady, still, evidence.parts), still, 0.0
    if scene.change.any():  # a camera that is off may be off by more
        least = JOINT_FIT.hint_gain if gain else JOINT_FIT.min_gain
        better, moving = camera_from_motion(scene, least)
    if not shift_px and not gain and not moving:
        return evidence, ()
    offset_m = better.T_wc[:3, 3] - camera.T_wc[:3, 3]
    step = TraceStep(
        title="camera calibration",
        text="the camera was refined from the static pixels and from the motion",
        figures={
            "shake_px": shift_px,
            "explains_better": gain,
            "explains_motion_better": moving,
            "moved_m": float(np.linalg.norm(offset_m)),
        },
        seconds=time.monotonic() - start,
    )
    return replace(evidence, video=steady, camera=better), (step,)


@dataclass(frozen=True, eq=False)
class CameraHypothesis:
    """Some frames and the object with one moving part, compared at one resolution."""

    crop: Crop
    surface: PartSurface
    corners: Ints
    """Indices of the vertices that move (K,)."""
    motion: JointMotion
    middle_o: Array
    """Centre of the object (3,) [m]."""
    fit_level: FitLevel
    light: Array
    behind: Floats
    """Background colours (H, W, 3), 0 to 255."""

    def seen(self, x: Array, q: float) -> RasterizedSurface:
        """Rasterize the object under a camera offset ``x`` with the part at position ``q``."""
        points, T_o = self.surface.points_o.copy(), self.motion.T_o(np.asarray(q))
        points[self.corners] = points[self.corners] @ T_o[:3, :3].T + T_o[:3, 3]
        there = replace(self.crop, T_co=perturb_camera(self.crop.T_co, self.middle_o, x))
        return rasterize(replace(self.surface, points_o=points), there)

    def residuals(self, k: int, x: Array, q: float) -> Floats:
        """Return rendered minus observed colours of frame ``k`` (pixels, 3)."""
        seen, model = self.seen(x, q), self.behind.copy()
        solid = seen.face_ids >= 0
        colours = face_colours(seen.points_c, self.surface.faces, self.surface.albedo, self.light)
        model[solid] = colours[seen.face_ids[solid]]
        off = cv2.GaussianBlur(model - self.crop.frames[k], (0, 0), self.fit_level.blur_px)
        return np.asarray(off).reshape(-1, 3)

    def all_residuals(self, x: Array, q: Array) -> list[Floats]:
        """Return the residuals of all frames, positions ``q`` (T,)."""
        return [self.residuals(k, x, float(position)) for k, position in enumerate(q)]

    def cost(self, residuals: Sequence[Floats]) -> float:
        """Return the mean over frames and pixels of the absolute differences, each capped."""
        sums = [np.minimum(absolute_sum(off), self.fit_level.cost_cap) for off in residuals]
        return float(np.mean([s.mean() for s in sums]))

    def nearest(self, x: Array, q: Array, tried: Array) -> Array:
        """Return the position of least cost per frame, of ``tried`` (Q,) and ``q`` (T,)."""
        best = q.copy()
        for k, position in enumerate(q.tolist()):
            positions = np.append(tried, position)
            costs = [self.cost([self.residuals(k, x, float(value))]) for value in positions]
            best[k] = positions[int(np.argmin(costs))]
        return best

    def fitted(self, x: Array, q: Array) -> CameraHypothesis:
        """Return a copy with light and background estimated at ``x`` (6,), ``q`` (T,)."""
        views, albedo, colours, covers = [], [], [], []
        for frame, position in zip(self.crop.frames, q, strict=True):
            seen = self.seen(x, float(position))
            covers.append(seen.face_ids >= 0)
            inner = cv2.erode(covers[-1].astype(np.uint8), np.ones((3, 3))) > 0
            ids = seen.face_ids[inner]
            views.append(face_views(seen.points_c, self.surface.faces)[ids])
            albedo.append(self.surface.albedo[ids])
            colours.append(frame[inner])
        light = solve_light(*(np.concatenate(column) for column in (views, albedo, colours)))
        return replace(self, light=light, behind=_behind(self.crop.frames, np.array(covers)))


def _behind(frames: Floats, covers: NDArray[np.bool_]) -> Floats:
    """Return the mean background colour (H, W, 3), extrapolated below the object."""
    room = 1 + round(0.04 * max(covers.shape[1:]))
    kernel = np.ones((2 * room + 1, 2 * room + 1))
    free = np.stack([cv2.dilate(c.astype(np.uint8), kernel) == 0 for c in covers])[..., None]
    count = free.sum(axis=0)
    mean = (frames * free).sum(axis=0) / np.maximum(count, 1)
    known = count[..., 0] > 0
    if not known.any():
        return np.full(frames.shape[1:], 255.0, dtype=np.float32)
    return np.where(known[..., None], mean, spread_behind(mean, known)).astype(np.float32)


def camera_from_motion(
    scene: VideoScene, least: float = JOINT_FIT.min_gain
) -> tuple[Camera, float]:
    """Return the camera close to that of ``scene`` under which the object moves as in the video.

    Args:
        scene: The video, with the nominal camera.
        least: Share by which another camera has to explain the video better.

    Returns:
        The camera, and the share by which it lowers the differences; the camera of ``scene`` and 0
        where no other is clearly better.
    """
    camera, gain = _camera_once(scene, JOINT_FIT.clear_cost if least >= JOINT_FIT.min_gain else 0.0)
    if gain < least:
        return scene.camera, 0.0
    for _ in range(JOINT_FIT.passes - 1):
        again, more = _camera_once(replace(scene, camera=camera), 0.0)
        if more > 0.0:
            camera, gain = again, 1.0 - (1.0 - gain) * (1.0 - more)
    return camera, gain


def _camera_once(scene: VideoScene, clear: float) -> tuple[Camera, float]:
    """Return a better camera than that of ``scene`` by the candidate motions, and its gain.

    None is sought where one of the first motions costs less than ``clear`` under the nominal
    camera.
    """
    fits, frames = _motions(scene)
    at_nominal = [_at_nominal_camera(scene, fit, frames) for fit in fits[: JOINT_FIT.min_motions]]
    if any(nominal < clear for _, _, nominal in at_nominal):
        return scene.camera, 0.0
    best: tuple[float, float, MotionFit, Array, Array] | None = None
    for n, fit in enumerate(fits):
        if n >= JOINT_FIT.min_motions and best is not None and best[0] < JOINT_FIT.good_cost:
            if best[0] > (1.0 - JOINT_FIT.hint_gain) * best[1]:
                return scene.camera, 0.0
            break
        view, q, nominal = (
            at_nominal[n] if n < JOINT_FIT.min_motions else _at_nominal_camera(scene, fit, frames)
        )
        x, q, cost = _optimize_far(view, np.zeros(6), q)
        if best is None or cost < best[0]:
            best = (cost, nominal, fit, x, q)
    if best is None:
        return scene.camera, 0.0
    _, _, fit, x, q = best
    for fit_level in JOINT_FIT.levels:
        view = _hypothesis(scene, fit, frames, fit_level, x)
        _, _, nominal = _optimize_far(view, np.zeros(6), fit.q, turned=False)
        x, q, cost = _optimize(view, x, q)
    gain = max(0.0, 1.0 - cost / max(nominal, 1e-9))
    return scene.camera.at(inverse(perturb_camera(scene.camera.T_cw, view.middle_o, x))), gain


def _at_nominal_camera(
    scene: VideoScene, fit: MotionFit, frames: Ints
) -> tuple[CameraHypothesis, Array, float]:
    """Return the hypothesis, the best positions under the nominal camera, and their cost."""
    view = _hypothesis(scene, fit, frames, JOINT_FIT.first_level, np.zeros(6))
    _, q, nominal = _optimize_far(view, np.zeros(6), fit.q, turned=False)
    return view, q, nominal


def _motions(scene: VideoScene) -> tuple[list[MotionFit], Ints]:
    """Return the best motions under the nominal camera and the frames of their ``q``."""
    level = scene.level(IMAGE.quick_px, IMAGE.quick_frames)
    few = np.unique(
        np.linspace(0, len(level.crop.indices) - 1, JOINT_FIT.frames).round().astype(int)
    )
    ranked = rank_parts(level)
    hidden = [part for part in hidden_parts(level) if part not in ranked]
    fits: list[MotionFit] = []
    for part in [*ranked[: JOINT_FIT.visible_parts], *hidden[: JOINT_FIT.hidden_parts]]:
        fits += _fits(level, part, SEARCH.slide_reach_share * scene.size_m)
    fits.sort(key=lambda fit: -fit.score)
    found = [attach_parts(level, fit, ranked) for fit in _distinct_motions(fits)]
    return [replace(fit, q=fit.q[few]) for fit in found], level.crop.indices[few]


def _fits(level: PyramidLevel, part: int, reach_m: float) -> list[MotionFit]:
    layers, motions = level.compositing([part]), frame_motions(level, part)
    return [fit for motion in motions for fit in coarse_fits(motion, layers, (part,), reach_m)]


def _distinct_motions(fits: Sequence[MotionFit]) -> list[MotionFit]:
    """Return the first of ``fits`` that differ; free and uniform paths always do."""
    found: list[MotionFit] = []
    for fit in fits:
        if not any(_same_motion(fit, one) for one in found):
            found.append(fit)
        if len(found) == JOINT_FIT.max_motions:
            break
    return found


def _same_motion(a: MotionFit, b: MotionFit) -> bool:
    if (a.motion.kind, a.uniform, a.parts) != (b.motion.kind, b.uniform, b.parts):
        return False
    if abs(float(a.motion.axis_o @ b.motion.axis_o)) < JOINT_FIT.same_axis_cos:
        return False
    off = np.cross(a.motion.pivot_o - b.motion.pivot_o, b.motion.axis_o)
    return a.motion.kind == "slide" or float(np.linalg.norm(off)) <= JOINT_FIT.same_pivot_m


def _hypothesis(
    scene: VideoScene, fit: MotionFit, frames: Ints, fit_level: FitLevel, x: Array
) -> CameraHypothesis:
    """Build the hypothesis of ``fit`` around the object as seen under a camera offset ``x``."""
    middle_o = joint_bounds(scene.parts).mean(axis=0)
    nearby = scene.camera.at(inverse(perturb_camera(scene.camera.T_cw, middle_o, x)))
    own, change = object_box(nearby, scene.parts), scene.box
    left, right = min(own[0], change[0]), max(own[1], change[1])
    box = (left, right, min(own[2], change[2]), max(own[3], change[3]))
    crop = crop_video(scene.video, scene.camera, frames, box, fit_level.max_px)
    surface = build_surface(scene.parts, pixel_m=crop.pixel_m(middle_o))
    moving = np.isin(surface.part_ids, list(fit.parts))
    return CameraHypothesis(
        crop=crop,
        surface=surface,
        corners=np.unique(surface.faces[moving]),
        motion=fit.motion,
        middle_o=middle_o,
        fit_level=fit_level,
        light=np.zeros(0),
        behind=np.zeros(0, dtype=np.float32),
    )


def _optimize(
    view: CameraHypothesis, x: Array, q: Array, *, turned: bool = True
) -> tuple[Array, Array, float]:
    """Return the camera offset and positions of least cost close to ``x`` and ``q``, and that cost.

    Gauss-Newton with weights for absolute differences, with Levenberg-Marquardt damping.

    Args:
        view: The frames and the motion.
        x: Initial camera offset (6,).
        q: Initial positions (T,) [m or rad].
        turned: Optimize the camera too; otherwise the positions only.
    """
    view = view.fitted(x, q)
    off = view.all_residuals(x, q)
    cost, damping = view.cost(off), 0.1
    step = view.fit_level.step_share * CAMERA_STEPS * turned
    step_q = view.fit_level.step_share * POSITION_STEPS[view.motion.kind]
    for _ in range(view.fit_level.rounds):
        normal, force = _equations(view, x, q, off, step, step_q)
        diagonal = np.diag(np.diag(normal) + 1e-6 * np.trace(normal) / len(normal) + 1e-12)
        before = cost
        for _ in range(JOINT_FIT.damping_rounds):
            change = np.linalg.solve(normal + damping * diagonal, force)
            x_next, q_next = x - step * change[:6], q - step_q * change[6:]
            tried = view.all_residuals(x_next, q_next)
            if view.cost(tried) < cost:
                x, q, cost, damping = x_next, q_next, view.cost(tried), 0.2 * damping
                break
            damping *= 6.0
        if before - cost < JOINT_FIT.converged * before:
            break
        view = view.fitted(x, q)
        off = view.all_residuals(x, q)
        cost = view.cost(off)
    return x, q, cost


def _optimize_far(
    view: CameraHypothesis, x: Array, q: Array, *, turned: bool = True
) -> tuple[Array, Array, float]:
    """Optimize as :func:`_optimize`, and from distant positions too where much is unexplained.

    A path found under another camera may be wrong by half a turn in some frames, which no local
    steps correct.
    """
    found = _optimize(view, x, q, turned=turned)
    if found[2] <= JOINT_FIT.good_cost:
        return found
    near, there = view.fitted(*found[:2]), found[1]
    far = near.nearest(found[0], there, _far_positions(view.motion, there))
    return min(found, _optimize(view, found[0], far, turned=turned), key=lambda one: one[2])


def _far_positions(motion: JointMotion, q: Array) -> Array:
    """Return positions to try in each frame: a full turn, or twice the reach of ``q`` (T,)."""
    if motion.kind == "turn":
        return np.arange(JOINT_FIT.positions, dtype=np.float64) * (
            2.0 * np.pi / JOINT_FIT.positions
        )
    reach = 2.0 * float(np.abs(q).max())
    return np.asarray(np.linspace(-reach, reach, JOINT_FIT.positions))


def _equations(
    view: CameraHypothesis, x: Array, q: Array, off: Sequence[Floats], step: Array, step_q: float
) -> tuple[Array, Array]:
    """Return the normal matrix (6 + T, 6 + T) and right side (6 + T,), in steps."""
    n = 6 + len(q)
    normal, force = np.zeros((n, n)), np.zeros(n)
    own = [a for a in range(6) if step[a] > 0.0]
    for k, position in enumerate(q.tolist()):
        size = absolute_sum(off[k])
        weight = np.repeat(
            (size < view.fit_level.cost_cap) / np.maximum(size, JOINT_FIT.soft_residual), 3
        )
        rows = [
            _slope(view, k, x, position, JOINT_FIT.slope_share * step * (np.arange(6) == a))
            for a in own
        ]
        rows.append(_slope(view, k, x, position, np.zeros(6), JOINT_FIT.slope_share * step_q))
        slopes = np.stack(rows).astype(np.float64)
        where = [*own, 6 + k]
        normal[np.ix_(where, where)] += (slopes * weight) @ slopes.T
        force[where] += (slopes * weight) @ off[k].ravel()
    return normal, force


def _slope(
    view: CameraHypothesis, k: int, x: Array, q: float, dx: Array, dq: float = 0.0
) -> Floats:
    """Return the change of the residuals of frame ``k`` (3 pixels,) by a full step."""
    change = view.residuals(k, x + dx, q + dq) - view.residuals(k, x - dx, q - dq)
    return np.asarray(0.5 / JOINT_FIT.slope_share * change.ravel())
