"""Query of a reconstruction: a video, an image or a text about the object, and a camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from articulate.errors import ConfigError, UsageError, shorten
from articulate.image_file import read_image
from articulate.reconstruct.actors.modality import Modality
from articulate.reconstruct.actors.protocol import Pixels
from articulate.render.camera import (
    FRONT_EYE_W,
    FRONT_FOVY_RAD,
    FRONT_TARGET_W,
    Camera,
    look_at,
    pinhole,
)
from articulate.transforms import Array
from articulate.untrusted import load_json_object
from articulate.video.read_video import VideoReadOptions, check_motion, read_video

LONGEST_SIDE_PX = 1280
"""Longest side of videos and images; larger ones are scaled down."""
MAX_FRAMES = 100
"""Most frames of a video that are used, evenly spread."""
MAX_PIXELS = 100_000_000
"""Most pixels of an image that is read."""
MIN_SIDE_PX = 16
"""Smallest side of an image, after it is scaled down."""
MAX_SIDE_PX = 10_000
"""Largest side of the images of a camera."""
BACKGROUND_CHANGE = 24.0
"""Pixels that differ less from the median of the image's border are background, 0 to 255."""
MIN_SHARE = 0.002
"""Smallest share of an image that an object covers."""
MAX_CHARACTERS = 2000
"""Longest text."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Query:
    """Description of an object and its motion by the user."""

    modality: Modality
    description: str
    """Short description of the input, for messages."""
    video: Pixels | None = None
    times_s: Array | None = None
    image: Pixels | None = None
    text: str = ""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the video or image; 640 x 480 without one."""
        if self.video is not None:
            return int(self.video.shape[2]), int(self.video.shape[1])
        if self.image is not None:
            return int(self.image.shape[1]), int(self.image.shape[0])
        return 640, 480


def video_query(path: Path, text: str = "") -> Query:
    """Read a video in which a part moves.

    Raises:
        UsageError: It cannot be read, has fewer than two frames, or shows no motion.
    """
    _is_file(path)
    video = read_video(
        path, VideoReadOptions(longest_side_px=LONGEST_SIDE_PX, most_frames=MAX_FRAMES)
    )
    check_motion(video.frames, str(path))
    return Query(
        modality="video",
        description=f"the video {path.name}",
        video=video.frames,
        times_s=video.times_s,
        text=text,
    )


def image_query(path: Path, text: str = "") -> Query:
    """Read an image of the object.

    Raises:
        UsageError: It cannot be read, or shows no object.
    """
    if not _is_file(path):
        if path.is_dir():
            raise UsageError(f"{path}: is a folder; give an image, e.g. a .png")
        raise UsageError(f"{path}: no such file; give an image, e.g. a .png")
    if path.stat().st_size == 0:
        raise UsageError(f"{path}: is empty; give an image of the object")
    pixels = read_image(path, max_pixels=MAX_PIXELS)
    factor = LONGEST_SIDE_PX / max(pixels.shape[:2])
    if min(1.0, factor) * min(pixels.shape[:2]) < MIN_SIDE_PX:
        raise UsageError(
            f"{path}: has {pixels.shape[1]}x{pixels.shape[0]} px, which is too narrow; give an "
            "image of the entire object"
        )
    if factor < 1.0:
        small = cv2.resize(pixels, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        pixels = np.asarray(small, dtype=np.uint8)
    image = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), dtype=np.uint8)
    share = float(foreground(image).mean())
    if share < MIN_SHARE:
        raise UsageError(
            f"{path}: shows no object ({share:.2%} of it differ from its border); give an image "
            "of the object"
        )
    return Query(modality="image", description=f"the image {path.name}", image=image, text=text)


def _is_file(path: Path) -> bool:
    """Return whether the file exists; reject paths that cannot exist, as one that is too long."""
    try:
        return path.is_file()
    except OSError as error:
        where = shorten(path)
        raise UsageError(f"{where}: cannot be read ({error.strerror}); give another path") from None


def text_query(text: str) -> Query:
    """Check a text about the object.

    Raises:
        ConfigError: It is empty, too long, or not UTF-8.
    """
    if not text.isprintable() and any("\ud800" <= letter <= "\udfff" for letter in text):
        raise ConfigError("--text holds bytes that are not UTF-8; write it in UTF-8")
    words = " ".join(text.split())
    if not any(letter.isalpha() for letter in words):
        raise ConfigError('--text is empty; describe the object, e.g. "a cabinet with a drawer"')
    if len(words) > MAX_CHARACTERS:
        raise ConfigError(
            f"--text has {len(words)} characters; at most {MAX_CHARACTERS} are accepted: shorten it"
        )
    return Query(modality="text", description=f'"{shorten(words)}"', text=words)


def foreground(image: Pixels) -> np.ndarray:
    """Return where an image (H, W, 3) differs from the median of its border, a mask (H, W)."""
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    median = np.median(border.astype(np.float64), axis=0)
    return np.asarray(np.abs(image - median).max(axis=-1) > BACKGROUND_CHANGE)


@dataclass(frozen=True, kw_only=True)
class QueryCamera:
    """Camera of a video or image, in the frame of the parts."""

    file: Path | None = None
    """JSON file with width_px, height_px, fx_px, fy_px, cx_px, cy_px and T_oc, the pose of OpenCV's
    camera axes in the frame of the parts; it replaces the other fields."""
    eye: tuple[float, float, float] = FRONT_EYE_W
    """Position of the camera [m]."""
    target: tuple[float, float, float] = FRONT_TARGET_W
    """Point in the centre of the image [m]."""
    fovy: float = float(np.degrees(FRONT_FOVY_RAD))
    """Vertical field of view [deg]."""

    def __post_init__(self) -> None:
        """Check the field of view."""
        if not 1.0 <= self.fovy <= 170.0:
            raise ConfigError(f"--camera-fovy is {self.fovy:g} degrees; it must lie in [1, 170]")

    def camera(self, width_px: int, height_px: int) -> Camera:
        """Return the camera for images of this size.

        Raises:
            ConfigError: The file is invalid, or for images of another shape.
        """
        if self.file is not None:
            return _fitting(read_camera(self.file), width_px, height_px, self.file)
        return pinhole(
            width_px=width_px,
            height_px=height_px,
            fovy_rad=float(np.radians(self.fovy)),
            T_wc=look_at(self.eye, self.target),
        )


def read_camera(path: Path) -> Camera:
    """Read a camera from a JSON file.

    Raises:
        ConfigError: It is not a camera.
    """
    try:
        content = load_json_object(path, limit_bytes=100_000, error=ConfigError)
    except ConfigError as error:
        raise ConfigError(f"--camera-file {error}") from None
    try:
        T_oc = np.array(content["T_oc"], dtype=np.float64)
        if T_oc.shape != (4, 4) or not np.isfinite(T_oc).all():
            raise ValueError("T_oc is not a pose of 4x4 numbers")
        if not np.allclose(T_oc[:3, :3] @ T_oc[:3, :3].T, np.eye(3), atol=1e-3):
            raise ValueError("T_oc holds no rotation")
        if np.linalg.det(T_oc[:3, :3]) < 0.0:
            raise ValueError("T_oc holds a mirror image, not a rotation")
        if not np.allclose(T_oc[3], [0.0, 0.0, 0.0, 1.0], atol=1e-6):
            raise ValueError("the last row of T_oc is not 0, 0, 0, 1")
        sizes = [int(content[name]) for name in ("width_px", "height_px")]
        if not all(1 <= size <= MAX_SIDE_PX for size in sizes):
            raise ValueError(f"width_px and height_px must be 1 to {MAX_SIDE_PX}")
        focal = [_finite(content, name) for name in ("fx_px", "fy_px")]
        centre = [_finite(content, name) for name in ("cx_px", "cy_px")]
        return Camera(
            width_px=sizes[0],
            height_px=sizes[1],
            fx_px=focal[0],
            fy_px=focal[1],
            cx_px=centre[0],
            cy_px=centre[1],
            T_wc=T_oc,
        )
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else shorten(error)
        raise ConfigError(
            f"--camera-file {path}: not a camera ({reason}); it holds width_px, height_px, fx_px, "
            "fy_px, cx_px, cy_px and T_oc"
        ) from None


def _finite(content: Mapping[str, Any], name: str) -> float:
    value = float(content[name])
    if not np.isfinite(value):
        raise ValueError(f"{name} is {value}")
    return value


def _fitting(camera: Camera, width_px: int, height_px: int, path: Path) -> Camera:
    factor = width_px / camera.width_px
    if abs(camera.height_px * factor - height_px) > 2.0:
        raise ConfigError(
            f"--camera-file {path}: is for {camera.width_px}x{camera.height_px} px, and the input "
            f"has {width_px}x{height_px}; give the camera of this video or image"
        )
    return camera if width_px == camera.width_px else camera.scaled(factor)
