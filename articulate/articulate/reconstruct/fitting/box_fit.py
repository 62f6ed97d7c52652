"""Fit a box and an unknown camera to predicted corners, mask and edges of an object in an image.

The box has its front at +x, its bottom on z = 0 and height 1. Parameters: logarithms of width
and depth, azimuth, elevation and roll of the camera, logarithms of distance and focal length, and
the position of the box's centre in the image.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from articulate.reconstruct.fitting.box_cost import (
    N_PARAMETERS,
    OUT,
    SIGNS,
    box_cost,
    overlap,
    project,
    rotation,
)
from articulate.reconstruct.fitting.box_network import BoxPrediction, predict_box
from articulate.render.camera import Camera
from articulate.render.raster import Pixels
from articulate.transforms import Array, pose

WORK_PX = 160
"""Longest side of the images that are compared [px]."""
EDGE_WEIGHT = 1.5
"""Weight of the distance of edges beside the overlap of the masks."""
MAX_EDGE_PX = 10.0
"""Distance at which a missing edge costs no more [px]."""
INNER_WEIGHT = 2.0
"""Weight of edges inside the silhouette, which give the depth."""
ROLL_SPREAD = 0.04
"""Spread of the roll of the camera [rad]."""
PRIOR_WEIGHT = 0.02
CORNER_WEIGHT = 0.1
"""Weight of the mean distance to the predicted corners, in their spreads."""
NAMES = ("width", "depth", "azimuth", "elevation", "roll", "distance", "focal", "u", "v")


@dataclass(frozen=True, kw_only=True)
class SizePrior:
    """Expected proportions: logarithm of width and depth over height, and their spread."""

    log_width: float = 0.0
    log_depth: float = 0.0
    spread: float = 0.6


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxFit:
    """Box and camera; the height of the box is 1."""

    width: float
    depth: float
    camera: Camera
    """Camera of the image in the frame of the box."""
    overlap: float
    """Intersection over union of the masks."""
    cost: float
    """Cost of outline, edges and expected proportions."""
    parameters: Mapping[str, float]

    def corners(self) -> Array:
        """Return the corners of the box (8, 3)."""
        return box_corners(self.width, self.depth)

    def front(self) -> Array:
        """Return the corners of the front in the image (4, 2) [px]: from top left clockwise."""
        w, d = self.width / 2, self.depth / 2
        corners = np.array([[d, -w, 1.0], [d, w, 1.0], [d, w, 0.0], [d, -w, 0.0]])
        uv, _ = self.camera.project(corners)
        return uv


def box_corners(width: float, depth: float) -> Array:
    """Return the corners (8, 3) of a box of height 1 on z = 0, its front at +x."""
    return 0.5 * SIGNS * [depth, width, 1.0] + [0.0, 0.0, 0.5]


def fit_box(image: Pixels, mask: NDArray[np.bool_], prior: SizePrior | None = None) -> BoxFit:
    """Fit a box to the object.

    Args:
        image: Colours (H, W, 3).
        mask: Pixels of the object (H, W).
        prior: Expected proportions.

    Raises:
        UsageError: The package with the weights of the ImageNet network is not installed.
    """
    target = _Target(image, mask, predict_box(image, mask), prior or SizePrior())
    return target.result(target.refine(target.start()))


class _Target:
    """Mask and edges at the working resolution, and the cost of parameters."""

    def __init__(
        self,
        image: Pixels,
        mask: NDArray[np.bool_],
        prediction: BoxPrediction,
        prior: SizePrior,
    ) -> None:
        self.size_px = (image.shape[1], image.shape[0])
        factor = WORK_PX / max(image.shape[:2])
        width, height = (max(8, round(factor * side)) for side in self.size_px)
        resized = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        share = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
        inside = np.asarray(share > 0.5)
        self.sums = np.zeros((height, width + 1), dtype=np.int64)
        self.sums[:, 1:] = np.cumsum(inside, axis=1)
        self.side_px = float(max(height, width))
        self.distance = edge_distance(np.asarray(resized, dtype=np.uint8)) / MAX_EDGE_PX
        scale = self.side_px / max(image.shape[:2])
        self.corners = np.empty((8, 3))
        self.corners[:, :2] = scale * prediction.corners
        self.corners[:, 2] = scale * prediction.corner_spread
        self.prior = np.full((N_PARAMETERS, 2), [0.0, np.inf])
        sizes = np.array([prior.log_width, prior.log_depth])
        seen, usual = prediction.spread[:2] ** -2.0, prior.spread**-2.0
        self.prior[:2, 0] = (seen * prediction.values[:2] + usual * sizes) / (seen + usual)
        self.prior[:2, 1] = (seen + usual) ** -0.5
        self.prior[2:4] = np.stack([prediction.values, prediction.spread], axis=1)[2:4]
        self.prior[4] = 0.0, ROLL_SPREAD
        focal = prediction.values[4] - np.log(max(image.shape[:2]))
        self.prior[6] = focal, prediction.spread[4]
        self.weights = np.array([EDGE_WEIGHT, INNER_WEIGHT, PRIOR_WEIGHT, CORNER_WEIGHT])
        self.uv = np.empty((8, 2))

    def start(self) -> Array:
        """Return the parameters (9,) that fit the predicted corners and values best."""
        first = np.zeros(N_PARAMETERS)
        known = np.isfinite(self.prior[:, 1])
        first[known] = self.prior[known, 0]
        first[7:] = self.corners[:, :2].mean(axis=0) / self.side_px
        first[5] = self._distance(first)

        def residuals(p: Array) -> Array:
            if not project(p, self.side_px, self.uv):
                return np.full(16 + int(known.sum()), OUT)
            off = (self.uv - self.corners[:, :2]) / self.corners[:, 2:]
            return np.concatenate(
                [off.ravel(), (p - self.prior[:, 0])[known] / self.prior[known, 1]]
            )

        return np.asarray(least_squares(residuals, first, loss="soft_l1", max_nfev=100).x)

    def simplex(self, start: Array) -> Array:
        """Return the initial simplex of the refinement (10, 9)."""
        steps = np.array([0.15, 0.2, 0.15, 0.1, 0.02, 0.1, 0.1, 0.02, 0.02])
        return np.concatenate([start[None], start + np.diag(steps)])

    def _distance(self, parameters: Array) -> float:
        """Return the logarithm of the distance at which the box is as large as predicted."""
        log_distance = 1.5
        wanted = float(np.linalg.norm(np.ptp(self.corners[:, :2], axis=0)))
        for _ in range(3):
            parameters[5] = log_distance
            if not project(parameters, self.side_px, self.uv):
                log_distance += 0.5
                continue
            extent = self.uv.max(axis=0) - self.uv.min(axis=0)
            log_distance += float(np.log(max(float(np.linalg.norm(extent)), 1.0) / wanted))
        return log_distance

    def cost(self, parameters: Array, weights: Array | None = None) -> float:
        """Return the cost of parameters (9,), with other weights (4,) if given."""
        return float(
            box_cost(
                parameters,
                self.sums,
                self.distance,
                self.corners,
                self.prior,
                self.weights if weights is None else weights,
                self.uv,
            )
        )

    def refine(self, start: Array) -> Array:
        """Return the parameters (9,) of a local optimum near a start."""
        options = {
            "maxfev": 500,
            "xatol": 1e-3,
            "fatol": 1e-4,
            "initial_simplex": self.simplex(start),
        }
        best = minimize(self.cost, start, method="Nelder-Mead", options=options)
        return np.asarray(best.x)

    def result(self, parameters: Array) -> BoxFit:
        """Return the fit at the resolution of the image."""
        width, depth = float(np.exp(parameters[0])), float(np.exp(parameters[1]))
        project(parameters, self.side_px, self.uv)
        return BoxFit(
            width=width,
            depth=depth,
            camera=camera_of(parameters, self.size_px),
            overlap=float(overlap(self.uv, self.sums)),
            cost=self.cost(parameters, self.weights * [1.0, 1.0, 1.0, 0.0]),
            parameters=dict(zip(NAMES, map(float, parameters), strict=True)),
        )


def edge_distance(image: Pixels) -> Array:
    """Return the distance of each pixel (H, W) to the next edge, at most ``MAX_EDGE_PX`` [px]."""
    edges = np.zeros(image.shape[:2], dtype=np.uint8)
    for channel in (*cv2.split(image), cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)):
        soft = cv2.GaussianBlur(channel, (0, 0), 0.8)
        high = max(20.0, 1.0 * float(np.median(np.abs(cv2.Laplacian(soft, cv2.CV_32F)))) * 12.0)
        edges |= np.asarray(cv2.Canny(soft, 0.4 * high, high), dtype=np.uint8)
    far = cv2.distanceTransform(255 - edges, cv2.DIST_L2, 3)
    return np.minimum(far, MAX_EDGE_PX)


def camera_of(p: Array, size_px: tuple[int, int]) -> Camera:
    """Return the camera in the frame of the box (z = 0 at its bottom) for images of this size."""
    side = float(max(size_px))
    rot = rotation(p[2], p[3], p[4])
    eye = -np.exp(p[5]) * rot[2] + [0.0, 0.0, 0.5]
    return Camera(
        width_px=size_px[0],
        height_px=size_px[1],
        fx_px=float(np.exp(p[6])) * side,
        fy_px=float(np.exp(p[6])) * side,
        cx_px=float(p[7]) * side - 0.5,
        cy_px=float(p[8]) * side - 0.5,
        T_wc=pose(eye, rot.T),
    )
