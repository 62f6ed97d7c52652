"""Detection of square markers in images, with corners to a fraction of a pixel."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.markers.layout import DICTIONARIES, SQUARE, dictionary_size
from articulate.transforms import Array, pose

Pixels = NDArray[np.uint8]
Detections = dict[int, Array]
"""Corners (4, 2) [px] by identifier of the marker, in the order of :data:`SQUARE`."""
EDGE_MARGIN = 0.12
"""Share of an edge at both ends that is not used for its line."""
EDGE_SAMPLES = 24
"""Profiles across an edge."""
EDGE_REACH = 0.45
"""Half of the length of a profile, in modules of the marker."""
PROFILE_STEP_PX = 0.25
"""Distance of the samples of a profile [px]."""
MIN_SIDE_PX = 12.0
"""Shortest edge that is refined by lines [px]."""
MAX_SHIFT = 0.35
"""Largest shift of a corner by the refinement, in modules."""


class PoseCandidate(NamedTuple):
    """Pose of a marker in the camera frame that explains its corners."""

    T_cm: Array
    """Pose (4, 4) [m]."""
    error_px: float
    """Root mean square reprojection error [px]."""


def gray_image(image: Pixels) -> Pixels:
    """Return a gray image (H, W) of a gray or BGR image (H, W) or (H, W, 3), values 0 to 255."""
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


class MarkerDetector:
    """Detector of the markers of one dictionary."""

    def __init__(self, dictionary: str, *, refine_edges: bool = True) -> None:
        """Create a detector.

        Args:
            dictionary: One of :data:`articulate.markers.layout.DICTIONARIES`.
            refine_edges: Fit lines to the four edges and intersect them, after OpenCV's sub-pixel
                corners. Lines average the noise over the complete edge.
        """
        dictionary_size(dictionary)
        name, _, self._modules = DICTIONARIES[dictionary]
        self._refine = refine_edges
        parameters = cv2.aruco.DetectorParameters()
        # The default is none, with errors of 2 cm in depth at 1 m.
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        self._detector = cv2.aruco.ArucoDetector(known, parameters)

    def detect(self, image: Pixels) -> Detections:
        """Return the corners of the markers in an image (H, W) or (H, W, 3), values 0 to 255.

        Of several markers with the same identifier none is returned.
        """
        gray = gray_image(image)
        detected: Any = self._detector.detectMarkers(gray)
        found, numbers, _ = detected
        ids = [] if numbers is None else numbers.ravel()
        corners: Detections = {}
        ambiguous: set[int] = set()
        for quad, number in zip(found, ids, strict=True):
            key = int(number)
            if key in corners:
                ambiguous.add(key)
            uv = np.asarray(quad, dtype=np.float64).reshape(4, 2)
            corners[key] = refined_corners(gray, uv, self._modules + 2) if self._refine else uv
        return {key: uv for key, uv in corners.items() if key not in ambiguous}


def refined_corners(gray: Pixels, corners: Array, modules: int) -> Array:
    """Return corners (4, 2) [px] as intersections of lines fitted to the edges of a marker.

    Each edge is sampled by profiles across it. The position of the edge in a profile is the mean
    position of its gradient; a line is fitted to these positions by total least squares with Huber
    weights. Where a corner moves far, an edge is covered, or the marker is small, the corners are
    returned as they are.

    Args:
        gray: Image (H, W), values 0 to 255.
        corners: Corners (4, 2) [px].
        modules: Modules on a side, the black border included.
    """
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    module = float(sides.min()) / modules
    if sides.min() < MIN_SIDE_PX:
        return corners
    lines = [
        _edge_line(gray, corners[k], corners[(k + 1) % 4], max(1.5, EDGE_REACH * module))
        for k in range(4)
    ]
    if any(line is None for line in lines):
        return corners
    out = np.empty((4, 2))
    for k in range(4):
        before, after = lines[k - 1], lines[k]
        assert before is not None
        assert after is not None
        matrix = np.stack([before[:2], after[:2]])
        if abs(np.linalg.det(matrix)) < 0.05:
            return corners
        out[k] = np.linalg.solve(matrix, [before[2], after[2]])
    shift = np.linalg.norm(out - corners, axis=1).max()
    return out if shift <= max(0.75, MAX_SHIFT * module) else corners


def _edge_line(gray: Pixels, a: Array, b: Array, reach: float) -> Array | None:
    """Return a line (nx, ny, n . p) through an edge from ``a`` to ``b``; None if it is unclear."""
    along = b - a
    length = float(np.linalg.norm(along))
    normal = np.array([along[1], -along[0]]) / length  # out of the marker, as corners go clockwise
    share = np.linspace(EDGE_MARGIN, 1.0 - EDGE_MARGIN, EDGE_SAMPLES)
    offsets = np.arange(-reach, reach + 1e-9, PROFILE_STEP_PX)
    middle = a + share[:, None] * along
    points = middle[:, None] + offsets[:, None] * normal
    u, v = points[..., 0].astype(np.float32), points[..., 1].astype(np.float32)
    values = cv2.remap(gray.astype(np.float32), u, v, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    slope = np.maximum(np.diff(values, axis=1), 0.0)  # black inside, white outside
    strength = slope.sum(axis=1)
    best = float(np.median(strength))
    usable = strength > 0.5 * best
    if best < 15.0 or usable.sum() < EDGE_SAMPLES // 2:
        return None
    slope = np.maximum(slope - 0.15 * slope.max(axis=1, keepdims=True), 0.0)
    centers = 0.5 * (offsets[1:] + offsets[:-1])
    weight = slope.sum(axis=1)
    at = (slope * centers).sum(axis=1) / np.maximum(weight, 1e-9)
    found = middle[usable] + at[usable, None] * normal
    return _line_of(found)


def _line_of(points: Array) -> Array | None:
    """Return the line (nx, ny, n . p) of points (N, 2) [px], robustly."""
    weight = np.ones(len(points))
    line = None
    for _ in range(4):
        mean = np.average(points, axis=0, weights=weight)
        centered = points - mean
        _, vectors = np.linalg.eigh((centered * weight[:, None]).T @ centered)
        n = vectors[:, 0]
        residual = np.abs(centered @ n)
        line = np.array([n[0], n[1], float(n @ mean)])
        bound = max(0.1, 1.5 * float(np.median(residual)))
        weight = np.minimum(1.0, bound / np.maximum(residual, 1e-9))
    return line if float(np.median(residual)) < 0.75 else None


def marker_poses(corners: Array, size_m: float, K: Array, dist: Array) -> list[PoseCandidate]:
    """Return the two poses of a square marker that explain its corners, the better one first.

    T. Collins and A. Bartoli, "Infinitesimal plane-based pose estimation", IJCV 109, 2014.

    Args:
        corners: Corners (4, 2) [px].
        size_m: Side of the marker [m].
        K: Intrinsic matrix (3, 3) [px].
        dist: Distortion coefficients (D,).
    """
    points = np.ascontiguousarray(size_m * SQUARE)
    solved: Any = cv2.solvePnPGeneric(
        points, np.ascontiguousarray(corners), K, dist, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    _, rotations, positions, errors = solved
    out = []
    for rotation, position, error in zip(rotations, positions, np.ravel(errors), strict=True):
        matrix, _ = cv2.Rodrigues(np.asarray(rotation, dtype=np.float64))
        T_cm = pose(np.asarray(position, dtype=np.float64).ravel(), matrix)
        if np.isfinite(T_cm).all() and T_cm[2, 3] > 0.0:
            out.append(PoseCandidate(T_cm, float(error)))
    return out
