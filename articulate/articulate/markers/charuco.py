"""Calibration of a camera from images of a ChArUco board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from articulate.errors import ConfigError, UsageError
from articulate.markers.camera_calibration import CameraCalibration
from articulate.markers.detection import Pixels, gray_image
from articulate.markers.layout import DICTIONARIES, dictionary_size
from articulate.transforms import Array

MIN_CORNERS = 8
"""Corners of the board that an image must show."""
MIN_VIEWS = 8
"""Images with enough corners that a calibration needs."""
MIN_COVERAGE = 0.4
"""Share of the image area in which corners must have been seen."""
MIN_TILT_RAD = 0.15
"""Least spread of the board's rotations: parallel boards do not determine the focal length."""
MAX_ERROR_PX = 1.0
"""Largest root mean square reprojection error [px]."""
MAX_OUTLIER = 3.0
"""Error of an image, relative to the median, above which it is left out."""
CELLS = (8, 6)
"""Columns and rows of the grid by which coverage is measured."""


@dataclass(frozen=True, kw_only=True)
class Board:
    """ChArUco board."""

    columns: int = 5
    """Squares in a row."""
    rows: int = 7
    """Squares in a column."""
    square_m: float = 0.035
    """Side of a square [m]."""
    marker_m: float = 0.026
    """Side of a marker [m]."""
    dictionary: str = "4x4_50"
    """Dictionary of its markers."""

    def __post_init__(self) -> None:
        size = dictionary_size(self.dictionary)
        if not (3 <= self.columns <= 30 and 3 <= self.rows <= 30):
            raise ConfigError(f"board of {self.columns}x{self.rows} squares; sides are 3 to 30")
        if self.columns * self.rows // 2 > size:
            raise ConfigError(
                f"board of {self.columns}x{self.rows} squares has more markers than the {size} of "
                f"dictionary {self.dictionary}"
            )
        if not 0.0 < self.marker_m < self.square_m <= 1.0:
            raise ConfigError(
                f"board: square_m is {self.square_m:g} and marker_m {self.marker_m:g}; the marker "
                "must be smaller than the square, of at most 1 m"
            )

    def opencv(self) -> Any:
        """Return the board as OpenCV's object."""
        known = cv2.aruco.getPredefinedDictionary(
            getattr(cv2.aruco, DICTIONARIES[self.dictionary][0])
        )
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, known)


@dataclass(frozen=True, eq=False)
class BoardView:
    """Corners of the board in one image."""

    name: str
    """Name of the image."""
    points_b: Array
    """Corners on the board (N, 3) [m]."""
    uv: Array
    """Corners in the image (N, 2) [px]."""


class BoardDetector:
    """Detector of a board."""

    def __init__(self, board: Board) -> None:
        """Create a detector of ``board``."""
        self._board: Any = board.opencv()
        self._detector = cv2.aruco.CharucoDetector(self._board)
        self._points = np.asarray(self._board.getChessboardCorners(), dtype=np.float64)

    def detect(self, image: Pixels, name: str) -> BoardView | None:
        """Return the corners in an image (H, W) or (H, W, 3), 0 to 255; None if they are few."""
        found: Any = self._detector.detectBoard(gray_image(image))
        corners, numbers = found[0], found[1]
        if numbers is None or len(numbers) < MIN_CORNERS:
            return None
        uv = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
        return BoardView(name, self._points[np.ravel(numbers).astype(int)], uv)


def calibrate_camera(
    views: Sequence[BoardView], size_px: tuple[int, int], camera: str, *, images: int
) -> CameraCalibration:
    """Return the intrinsics of a camera from views of a board.

    Views whose error is far above the others are left out.

    Args:
        views: Corners in several images.
        size_px: Width and height of the images [px].
        camera: Name of the camera.
        images: Number of images that were searched, for messages.

    Raises:
        UsageError: The views are too few, cover too little of the image, are too parallel, or do
            not agree.
    """
    if not views:
        raise UsageError(
            f"no board found in {images} images; check its size, its dictionary and the light"
        )
    if len(views) < MIN_VIEWS:
        raise UsageError(
            f"the board is visible in {len(views)} of {images} images; at least {MIN_VIEWS} are "
            "needed, from different distances and angles"
        )
    share = coverage(views, size_px)
    if share < MIN_COVERAGE:
        raise UsageError(
            f"the board covers {share:.0%} of the image area, less than {MIN_COVERAGE:.0%}; move "
            "it to the edges and corners of the image too"
        )
    used = list(views)
    while True:
        error, K, dist, rotations, errors = _solved(used, size_px)
        keep = errors <= max(MAX_OUTLIER * float(np.median(errors)), 0.5)
        if keep.all() or keep.sum() < MIN_VIEWS:
            break
        used = [view for view, good in zip(used, keep, strict=True) if good]
    spread = _tilt_spread(rotations)
    if spread < MIN_TILT_RAD:
        raise UsageError(
            f"the board is nearly parallel in all images ({np.degrees(spread):.0f} degrees); tilt "
            "it by 20 to 40 degrees in different directions"
        )
    if not error <= MAX_ERROR_PX:
        raise UsageError(
            f"the reprojection error is {error:.2f} px, above {MAX_ERROR_PX:g}; check that the "
            "board is flat, its size is right, images are sharp, and the focus is fixed"
        )
    rows = [tuple(float(v) for v in row) for row in K]
    return CameraCalibration(
        camera=camera,
        width_px=size_px[0],
        height_px=size_px[1],
        matrix=(rows[0], rows[1], rows[2]),  # type: ignore[arg-type]  # rows of three
        distortion=tuple(float(v) for v in dist),
        error_px=float(error),
        views=len(used),
        coverage=share,
    )


def coverage(views: Sequence[BoardView], size_px: tuple[int, int]) -> float:
    """Return the share of the cells of a grid over the image in which a corner was seen.

    Args:
        views: Corners in several images.
        size_px: Width and height of the images [px].
    """
    seen = np.zeros(CELLS, dtype=bool)
    for view in views:
        cell = (view.uv / np.array(size_px) * np.array(CELLS)).astype(int)
        cell = np.clip(cell, 0, np.array(CELLS) - 1)
        seen[cell[:, 0], cell[:, 1]] = True
    return float(seen.mean())


def _solved(
    views: Sequence[BoardView], size_px: tuple[int, int]
) -> tuple[float, Array, Array, list[Array], Array]:
    """Return error [px], matrix, distortion, rotations and the error of each view [px]."""
    points = [view.points_b.astype(np.float32).reshape(-1, 1, 3) for view in views]
    corners = [view.uv.astype(np.float32).reshape(-1, 1, 2) for view in views]
    calibrate: Any = cv2.calibrateCameraExtended
    found = calibrate(points, corners, size_px, None, None)
    error, K, dist, rvecs, _, _, _, errors = found
    rotations = [np.asarray(cv2.Rodrigues(vector)[0], dtype=np.float64) for vector in rvecs]
    return (
        float(error),
        np.asarray(K, dtype=np.float64),
        np.ravel(np.asarray(dist, dtype=np.float64)),
        rotations,
        np.ravel(np.asarray(errors, dtype=np.float64)),
    )


def _tilt_spread(rotations: Sequence[Array]) -> float:
    """Return the largest angle between normals of the board [rad]."""
    normals = np.stack([rotation[:, 2] for rotation in rotations])
    cosines = np.clip(normals @ normals.T, -1.0, 1.0)
    return float(np.arccos(cosines.min()))
