"""Fit an unknown camera to a mesh of known shape in an image, by outline and edges."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from articulate.reconstruct.fitting.box_fit import (
    EDGE_WEIGHT,
    MAX_EDGE_PX,
    NAMES,
    ROLL_SPREAD,
    SizePrior,
    camera_of,
    edge_distance,
    fit_box,
)
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.render.raster import Pixels
from articulate.render.scene import PartScene, RenderBuffers
from articulate.transforms import Array

WORK_PX = 128
"""Longest side of the images that are compared [px]."""
KNOWN = 0.02
"""Spread of the known proportions, as logarithms."""
TURNS_RAD = (0.0, 0.45, -0.45, 0.9, -0.9)
"""Changes of the azimuth from which the fit starts."""
TRIES, STEPS = 40, 160
"""Evaluations from each start, and of the best two further ones."""
CREASE = 0.85
"""Cosine of the angle between faces below which there is an edge."""
JUMP = 0.03
"""Relative change of the depth at an edge."""
FOCAL_SPREAD, FOCAL_WEIGHT = 0.35, 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class Registration:
    """Camera of an image in the frame of a mesh."""

    camera: Camera
    overlap: float
    """Intersection over union of the masks of object and mesh."""
    cost: float
    """Cost of outline and edges."""


def register(mesh: ScanMesh, image: Pixels, mask: NDArray[np.bool_]) -> Registration:
    """Fit the camera of an image to a mesh.

    Args:
        mesh: The object on z = 0, centred at x = y = 0; one of its sides at +x is visible.
        image: Colours (H, W, 3).
        mask: Pixels of the object (H, W).

    Raises:
        UsageError: The package with the weights of the ImageNet network is not installed.
    """
    depth, width, height = mesh.size
    prior = SizePrior(
        log_width=float(np.log(width / height)),
        log_depth=float(np.log(depth / height)),
        spread=KNOWN,
    )
    fit = fit_box(image, mask, prior)
    first = np.array([fit.parameters[name] for name in NAMES])
    first[:2] = prior.log_width, prior.log_depth
    target = _Target(mesh, image, mask, float(first[6]))
    starts = np.tile(first, (len(TURNS_RAD), 1))
    starts[:, 2] += TURNS_RAD
    tried = sorted((target.refined(start, TRIES) for start in starts), key=target.cost)
    best = min((target.refined(start, STEPS) for start in tried[:2]), key=target.cost)
    camera = scaled_camera(camera_of(best, (image.shape[1], image.shape[0])), height)
    return Registration(camera=camera, overlap=target.overlap(best), cost=target.cost(best))


def scaled_camera(camera: Camera, height: float) -> Camera:
    """Return the camera of an object of height 1 for the same object of another height [m]."""
    T_wc = camera.T_wc.copy()
    T_wc[:3, 3] *= height
    return camera.at(T_wc)


class _Target:
    """Mask and edges of an image at the working resolution, and the cost of a camera."""

    def __init__(
        self, mesh: ScanMesh, image: Pixels, mask: NDArray[np.bool_], log_focal: float
    ) -> None:
        factor = WORK_PX / max(image.shape[:2])
        self.size_px = (
            max(8, round(factor * image.shape[1])),
            max(8, round(factor * image.shape[0])),
        )
        resized = cv2.resize(image, self.size_px, interpolation=cv2.INTER_AREA)
        share = cv2.resize(mask.astype(np.float32), self.size_px, interpolation=cv2.INTER_AREA)
        self.mask = np.asarray(share > 0.5)
        self.distance = edge_distance(np.asarray(resized, dtype=np.uint8)) / MAX_EDGE_PX
        self.height = float(mesh.size[2])
        self.normals, self.rgb = mesh.normals, mesh.rgb
        part = PartMesh(name="scan", vertices=mesh.vertices, faces=mesh.faces, rgb=mesh.rgb)
        self.scene = PartScene([part])
        self.log_focal = log_focal

    def cost(self, parameters: Array) -> float:
        """Return the cost of a camera (9,); lower is better."""
        seen = self._seen(parameters)
        inside = seen.face_ids >= 0
        edges = _edges(seen, self.normals, self.rgb)
        far = float(self.distance[edges].mean()) if edges.any() else 1.0
        odd = (parameters[6] - self.log_focal) ** 2 / FOCAL_SPREAD**2
        odd += parameters[4] ** 2 / ROLL_SPREAD**2
        return 1.0 - self._iou(inside) + EDGE_WEIGHT * far + FOCAL_WEIGHT * float(odd)

    def overlap(self, parameters: Array) -> float:
        """Return the intersection over union of the masks for a camera (9,)."""
        return self._iou(self._seen(parameters).face_ids >= 0)

    def refined(self, start: Array, evaluations: int) -> Array:
        """Return the camera (9,) of a local optimum; the proportions stay."""
        steps = np.diag([0.15, 0.1, 0.02, 0.1, 0.1, 0.02, 0.02])
        simplex = np.concatenate([start[None, 2:], start[2:] + steps])
        found = minimize(
            lambda p: self.cost(np.concatenate([start[:2], p])),
            start[2:],
            method="Nelder-Mead",
            options={"maxfev": evaluations, "initial_simplex": simplex, "fatol": 1e-4},
        )
        return np.concatenate([start[:2], found.x])

    def _seen(self, parameters: Array) -> RenderBuffers:
        bounded = parameters.copy()
        bounded[5:7] = np.clip(bounded[5:7], [-1.0, -1.5], [4.0, 2.5])
        return self.scene.rasterize(scaled_camera(camera_of(bounded, self.size_px), self.height))

    def _iou(self, inside: NDArray[np.bool_]) -> float:
        return float((inside & self.mask).sum() / max(int((inside | self.mask).sum()), 1))


def _edges(seen: RenderBuffers, normals: Array, rgb: Array) -> NDArray[np.bool_]:
    """Return pixels at outlines, creases, steps and changes of colour (H, W)."""
    face = seen.face_ids
    inside = face >= 0
    which = np.maximum(face, 0)
    normal, colour, depth = normals[which], rgb[which], seen.inverse_depth
    edges = np.zeros(face.shape, dtype=np.bool_)
    for axis in (0, 1):
        a = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
        b = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        both = inside[a] & inside[b]
        step = np.abs(depth[a] - depth[b]) > JUMP * np.maximum(depth[a], depth[b])
        crease = (normal[a] * normal[b]).sum(axis=-1) < CREASE
        paint = np.abs(colour[a] - colour[b]).max(axis=-1) > 0.1
        edges[a] |= (both & (step | crease | paint)) | (inside[a] != inside[b])
    return edges
