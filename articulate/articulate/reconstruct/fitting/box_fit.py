"""Fit a box and an unknown camera to the mask and the edges of an object in an image.

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
from scipy.optimize import minimize
from scipy.stats import qmc

from articulate.reconstruct.fitting.box_cost import (
    N_PARAMETERS,
    SIGNS,
    box_cost,
    overlap,
    project,
    rotation,
)
from articulate.render.camera import Camera
from articulate.render.raster import Pixels
from articulate.transforms import Array, pose

WORK_PX = 160
"""Longest side of the images that are compared [px]."""
N_SAMPLES = 2048
N_REFINED = 10
N_REPEATED = 4
"""Optima that are refined again from a new simplex."""
AZIMUTH_BIN_RAD, ELEVATION_BIN_RAD = 0.6, 0.35
"""Starts in the same range of azimuth and elevation count once."""
EDGE_WEIGHT = 1.5
"""Weight of the distance of edges beside the overlap of the masks."""
MAX_EDGE_PX = 10.0
"""Distance at which a missing edge costs no more [px]."""
INNER_WEIGHT = 2.0
"""Weight of edges inside the silhouette, which give the depth."""
FOCAL = 1.2
"""Expected focal length in units of the longer side of the image."""
FOCAL_SPREAD, ROLL_SPREAD, AZIMUTH_SPREAD = 0.3, 0.04, 1.2
ELEVATION, ELEVATION_SPREAD = 0.4, 0.5
PRIOR_WEIGHT = 0.02
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


def fit_box(
    image: Pixels, mask: NDArray[np.bool_], prior: SizePrior | None = None, seed: int = 0
) -> list[BoxFit]:
    """Fit a box to the object and return the local optima, the one of least cost first.

    Args:
        image: Colours (H, W, 3).
        mask: Pixels of the object (H, W).
        prior: Expected proportions.
        seed: Seed of the starting points.
    """
    target = _Target(image, mask, prior or SizePrior())
    starts = target.starts(seed)
    costs = np.array([target.cost(start) for start in starts])
    found = [target.refine(starts[k]) for k in diverse(starts, costs)]
    found.sort(key=lambda one: one[1])
    again = [target.refine(parameters) for parameters, _ in found[:N_REPEATED]]
    fits = [target.result(*one) for one in (*again, *found[N_REPEATED:])]
    return sorted(fits, key=lambda fit: fit.cost)


def diverse(starts: Array, costs: Array) -> list[int]:
    """Return the starts of least cost, at most one of each range of azimuth and elevation."""
    azimuth = np.floor(starts[:, 2] / AZIMUTH_BIN_RAD).astype(int)
    elevation = np.floor(starts[:, 3] / ELEVATION_BIN_RAD).astype(int)
    found: dict[tuple[int, int], int] = {}
    for k in np.argsort(costs):
        found.setdefault((int(azimuth[k]), int(elevation[k])), int(k))
    return list(found.values())[:N_REFINED]


class _Target:
    """Mask and edges at the working resolution, and the cost of parameters."""

    def __init__(self, image: Pixels, mask: NDArray[np.bool_], prior: SizePrior) -> None:
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
        self.size_prior = prior
        self.prior = np.full((N_PARAMETERS, 2), [0.0, np.inf])
        self.prior[0] = prior.log_width, prior.spread
        self.prior[1] = prior.log_depth, prior.spread
        self.prior[2] = 0.0, AZIMUTH_SPREAD
        self.prior[3] = ELEVATION, ELEVATION_SPREAD
        self.prior[4] = 0.0, ROLL_SPREAD
        self.prior[6] = np.log(FOCAL), FOCAL_SPREAD
        self.weights = np.array([EDGE_WEIGHT, INNER_WEIGHT, PRIOR_WEIGHT])
        self.uv = np.empty((8, 2))
        rows, columns = np.nonzero(inside)
        self.box = np.array(
            [columns.min(), rows.min(), columns.max(), rows.max()], dtype=np.float64
        )

    def starts(self, seed: int) -> Array:
        """Return starting parameters (N, 9): the box spans the extent of the mask."""
        unit = qmc.Sobol(5, seed=seed).random(N_SAMPLES)
        prior = self.size_prior
        out = np.zeros((N_SAMPLES, N_PARAMETERS))
        out[:, 0] = prior.log_width + 2.0 * prior.spread * (unit[:, 0] - 0.5)
        out[:, 1] = prior.log_depth + 2.0 * prior.spread * (unit[:, 1] - 0.5)
        out[:, 2] = np.radians(65.0) * (2.0 * unit[:, 2] - 1.0)
        out[:, 3] = np.radians(-5.0 + 65.0 * unit[:, 3])
        out[:, 6] = np.log(FOCAL) + FOCAL_SPREAD * 2.0 * (unit[:, 4] - 0.5)
        out[:, 7:] = 0.5 * (self.box[:2] + self.box[2:]) / self.side_px
        for row in out:
            row[5] = self._distance(row)
        return out

    def simplex(self, start: Array) -> Array:
        """Return the initial simplex of the refinement (10, 9)."""
        steps = np.array([0.15, 0.2, 0.15, 0.1, 0.02, 0.1, 0.1, 0.02, 0.02])
        return np.concatenate([start[None], start + np.diag(steps)])

    def _distance(self, parameters: Array) -> float:
        """Return the logarithm of the distance at which the box is as large as the mask."""
        log_distance = 1.5
        wanted = float(np.linalg.norm(self.box[2:] - self.box[:2]))
        for _ in range(3):
            parameters[5] = log_distance
            if not project(parameters, self.side_px, self.uv):
                log_distance += 0.5
                continue
            extent = self.uv.max(axis=0) - self.uv.min(axis=0)
            log_distance += float(np.log(max(float(np.linalg.norm(extent)), 1.0) / wanted))
        return log_distance

    def cost(self, parameters: Array) -> float:
        """Return the cost of parameters (9,)."""
        return float(
            box_cost(parameters, self.sums, self.distance, self.prior, self.weights, self.uv)
        )

    def refine(self, start: Array) -> tuple[Array, float]:
        """Return the parameters (9,) and the cost of a local optimum near a start."""
        options = {
            "maxfev": 500,
            "xatol": 1e-3,
            "fatol": 1e-4,
            "initial_simplex": self.simplex(start),
        }
        best = minimize(self.cost, start, method="Nelder-Mead", options=options)
        return best.x, float(best.fun)

    def result(self, parameters: Array, cost: float) -> BoxFit:
        """Return the fit at the resolution of the image."""
        width, depth = float(np.exp(parameters[0])), float(np.exp(parameters[1]))
        project(parameters, self.side_px, self.uv)
        return BoxFit(
            width=width,
            depth=depth,
            camera=camera_of(parameters, self.size_px),
            overlap=float(overlap(self.uv, self.sums)),
            cost=cost,
            parameters=dict(zip(NAMES, map(float, parameters), strict=True)),
        )


def turned(fit: BoxFit) -> BoxFit:
    """Return the same box with its front at the other visible side."""
    p = dict(fit.parameters)
    p["width"], p["depth"] = p["depth"], p["width"]
    p["azimuth"] -= np.sign(p["azimuth"]) * np.pi / 2.0
    vector = np.array([p[name] for name in NAMES])
    size_px = (fit.camera.width_px, fit.camera.height_px)
    return BoxFit(
        width=fit.depth,
        depth=fit.width,
        camera=camera_of(vector, size_px),
        overlap=fit.overlap,
        cost=fit.cost,
        parameters=p,
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
