"""Recording of images from a camera for calibration and location."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from articulate.errors import UsageError
from articulate.markers.camera_device import OpenCvCamera, Pixels
from articulate.markers.charuco import BoardView

T = TypeVar("T")
MAX_FRAMES = 3000
"""Most frames that are searched for the board."""
NEW_VIEW_PX = 40.0
"""Motion of the board in the image from which a view counts as another one [px]."""


def record_images(
    device: str, camera: str, size_px: tuple[int, int] | None, count: int
) -> list[tuple[str, Pixels]]:
    """Return ``count`` images of a camera with their names.

    Raises:
        CameraError: The camera cannot be opened or is lost.
    """
    source = OpenCvCamera(device, camera, size_px)
    try:
        return [(f"image {k}", source.read().image) for k in range(count)]
    finally:
        source.close()


def record_views(
    device: str,
    camera: str,
    size_px: tuple[int, int] | None,
    count: int,
    detect: Callable[[Pixels, str], BoardView | None],
    show_progress: Callable[[str], None],
) -> tuple[list[BoardView], tuple[int, int], int]:
    """Return views of a board that is moved before a camera, the image size and the frames.

    Args:
        device: Video device.
        camera: Name of the camera.
        size_px: Width and height to request [px].
        count: Views to record.
        detect: Detector of the board.
        show_progress: Called with one line for each view.

    Raises:
        CameraError: The camera cannot be opened or is lost.
        UsageError: The board was not visible often enough.
    """
    source = OpenCvCamera(device, camera, size_px)
    views: list[BoardView] = []
    try:
        for k in range(MAX_FRAMES):
            image = source.read().image
            view = detect(image, f"frame {k}")
            if view is None or not all(_is_new(view, other) for other in views):
                continue
            views.append(view)
            show_progress(f"view {len(views)} of {count}; move or tilt the board")
            if len(views) == count:
                return views, (image.shape[1], image.shape[0]), k + 1
    finally:
        source.close()
    raise UsageError(
        f"{len(views)} of {count} views of the board in {MAX_FRAMES} frames; check its size, its "
        "dictionary and the light"
    )


def _is_new(view: BoardView, other: BoardView) -> bool:
    """Return whether the board moved or tilted between two views."""
    a, b = (np.concatenate([v.uv.mean(axis=0), v.uv.std(axis=0)]) for v in (view, other))
    return float(np.abs(a - b).max()) > NEW_VIEW_PX
