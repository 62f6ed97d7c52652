"""Cameras: webcams and RealSense through OpenCV, and image files."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.errors import ConfigError, UsageError, quote
from articulate.image_file import read_image

Pixels = NDArray[np.uint8]
MAX_IMAGE_PIXELS = 64_000_000
"""Largest image."""
IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp"})
WARM_UP_FRAMES = 10
"""Images after opening that are discarded: exposure and focus settle."""


class CameraError(UsageError):
    """A camera cannot be opened or does not deliver images."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One image with its time."""

    image: Pixels
    """Image (H, W) gray or (H, W, 3) BGR, values 0 to 255."""
    time_s: float
    """Time of the exposure on the clock of the estimator [s]."""


class CameraDevice(Protocol):
    """Source of images."""

    name: str
    """Name of the camera, as in its calibration."""

    def read(self) -> Frame:
        """Return the next image; CameraError if there is none."""

    def close(self) -> None:
        """Release the camera."""


class OpenCvCamera:
    """Webcam or the colour stream of a RealSense as a :class:`CameraDevice`.

    Exposure time is not known: the time of a frame is that of its arrival. A fixed focus is
    requested, because a calibration holds at one focus only.
    """

    def __init__(self, device: str, name: str, size_px: tuple[int, int] | None = None) -> None:
        """Open a camera.

        Args:
            device: Number of a video device, its path, or an address that OpenCV reads.
            name: Name of the camera, as in its calibration.
            size_px: Width and height to request [px]; None keeps the default of the device.

        Raises:
            CameraError: The camera cannot be opened or has no images of that size.
        """
        self.name = name
        self._device = device
        self._capture = cv2.VideoCapture(int(device) if device.isdecimal() else device)
        if not self._capture.isOpened():
            raise CameraError(
                f"camera {quote(device)} cannot be opened; list cameras with v4l2-ctl "
                "--list-devices, and close other programs that use it"
            )
        if size_px is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
        self._capture.set(cv2.CAP_PROP_AUTOFOCUS, 0)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        for _ in range(WARM_UP_FRAMES):
            frame = self.read()
        height, width = frame.image.shape[:2]
        if size_px is not None and (width, height) != size_px:
            self.close()
            raise CameraError(
                f"camera {quote(device)} has images of {width}x{height} px, not "
                f"{size_px[0]}x{size_px[1]}; calibrate it at a size that it has"
            )

    def read(self) -> Frame:
        """Return the next image."""
        ok, image = self._capture.read()
        if not ok or image is None:
            raise CameraError(f"camera {quote(self._device)} is lost: it delivers no image")
        return Frame(np.asarray(image, dtype=np.uint8), time.monotonic())

    def close(self) -> None:
        """Release the camera."""
        self._capture.release()


def image_files(paths: Sequence[Path]) -> list[Path]:
    """Return image files, with folders replaced by their images in the order of their names.

    Raises:
        ConfigError: A path does not exist, or a folder has no images.
    """
    out: list[Path] = []
    for path in paths:
        if not path.is_dir():
            if not path.exists():
                raise ConfigError(f"{path}: does not exist; give images or a folder of images")
            out.append(path)
            continue
        found = sorted(p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
        if not found:
            raise ConfigError(f"{path}: no images in it ({', '.join(sorted(IMAGE_SUFFIXES))})")
        out += found
    return out


def read_gray(path: Path) -> Pixels:
    """Return the gray image (H, W) in a file, values 0 to 255.

    Raises:
        ConfigError: It cannot be read, is too large, or is no image.
    """
    return read_image(path, max_pixels=MAX_IMAGE_PIXELS, is_gray=True, error=ConfigError)
