"""What a person gives besides parts: a clip, a picture or a sentence, and a camera."""

from __future__ import annotations

import io
import json
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from articulate.errors import ConfigError, UsageError
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
from articulate.video.read_video import VideoReadOptions, check_motion, read_video

LONGEST_SIDE_PX = 1280
"""Larger clips and pictures are made smaller."""
MOST_FRAMES = 100
"""Frames of a clip that are looked at, evenly spread."""
MOST_PIXELS = 100_000_000
"""Pixels of a picture that is read at all."""
LEAST_SIDE_PX = 16
"""Shorter sides, of pictures that are no larger than is looked at, show nothing."""
PLAIN = 24.0
"""Pixels that differ by less from what the picture's rim mostly shows are background, 0 to 255."""
LEAST_SHARE = 0.002
"""An object covers at least this share of a picture."""
MOST_LETTERS = 2000


@dataclass(frozen=True, kw_only=True, eq=False)
class Query:
    """What is known of how the object moves."""

    modality: Modality
    told: str
    """What was given, in a few words."""
    video: Pixels | None = None
    times_s: Array | None = None
    image: Pixels | None = None
    text: str = ""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of clip or picture; 640 x 480 without one."""
        if self.video is not None:
            return int(self.video.shape[2]), int(self.video.shape[1])
        if self.image is not None:
            return int(self.image.shape[1]), int(self.image.shape[0])
        return 640, 480


def video_question(path: Path, text: str = "") -> Query:
    """A film in which a part moves.

    Raises:
        UsageError: It cannot be read, is empty or of one frame, or nothing moves in it.
    """
    _is_file(path)
    clip = read_video(path, VideoReadOptions(longest_side_px=LONGEST_SIDE_PX, most_frames=MOST_FRAMES))
    check_motion(clip.frames, str(path))
    return Query(
        modality="video",
        told=f"the clip {path.name}",
        video=clip.frames,
        times_s=clip.times_s,
        text=text,
    )


def image_question(path: Path, text: str = "") -> Query:
    """A picture of the object.

    Raises:
        UsageError: It cannot be read, or shows nothing.
    """
    if not _is_file(path):
        raise UsageError(f"{path}: no such file; give a picture, e.g. a .png")
    if path.stat().st_size == 0:
        raise UsageError(f"{path}: is empty; give a picture of the object")
    read = _decoded(path)
    factor = LONGEST_SIDE_PX / max(read.shape[:2])
    if min(1.0, factor) * min(read.shape[:2]) < LEAST_SIDE_PX:
        raise UsageError(
            f"{path}: has {read.shape[1]}x{read.shape[0]} px, too narrow a picture; give one of "
            "the whole object"
        )
    if factor < 1.0:
        read = cv2.resize(read, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    picture = np.asarray(cv2.cvtColor(read, cv2.COLOR_BGR2RGB), dtype=np.uint8)
    share = float(foreground(picture).mean())
    if share < LEAST_SHARE:
        raise UsageError(
            f"{path}: shows no object ({share:.2%} of it differ from its rim); give a picture of "
            "the object"
        )
    return Query(modality="image", told=f"the picture {path.name}", image=picture, text=text)


def _decoded(path: Path) -> np.ndarray:
    """The picture in BGR (H, W, 3), refused by its size before it is decoded."""
    content = path.read_bytes()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content)) as opened:
                width, height = opened.size
    except Image.DecompressionBombError:
        raise UsageError(f"{path}: {_TOO_LARGE}") from None
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError):
        raise UsageError(f"{path}: {_NO_PICTURE}") from None
    if width * height > MOST_PIXELS:
        raise UsageError(f"{path}: {_TOO_LARGE}")
    try:
        read = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        read = None
    if read is None:
        raise UsageError(f"{path}: {_NO_PICTURE}")
    return np.asarray(read)


_NO_PICTURE = "cannot be read as a picture; .png and .jpg can"
_TOO_LARGE = f"has more than {MOST_PIXELS // 1_000_000} million pixels; give a smaller picture"


def _is_file(path: Path) -> bool:
    """Whether there is a file; UsageError if the path is none, as one that is too long."""
    try:
        return path.is_file()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror}); give another path") from None


def text_question(text: str) -> Query:
    """A sentence about the object.

    Raises:
        ConfigError: It says nothing, or too much.
    """
    if not text.isprintable() and any("\ud800" <= letter <= "\udfff" for letter in text):
        raise ConfigError("--text holds bytes that are not UTF-8; write it in UTF-8")
    said = " ".join(text.split())
    if not any(letter.isalpha() for letter in said):
        raise ConfigError('--text is empty; say what the object is, e.g. "a cabinet with a drawer"')
    if len(said) > MOST_LETTERS:
        raise ConfigError(
            f"--text has {len(said)} letters; at most {MOST_LETTERS} are read: say it shorter"
        )
    return Query(modality="text", told=f'"{said}"', text=said)


def foreground(picture: Pixels) -> np.ndarray:
    """Where a picture (H, W, 3) differs from what its rim mostly shows, (H, W)."""
    rim = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    usual = np.median(rim.astype(np.float64), axis=0)
    return np.asarray(np.abs(picture - usual).max(axis=-1) > PLAIN)


@dataclass(frozen=True, kw_only=True)
class View:
    """Where the camera of clip or picture stands, in the frame of the parts."""

    file: Path | None = None
    """JSON file with width_px, height_px, fx_px, fy_px, cx_px, cy_px and T_oc, which places
    OpenCV's axes in the frame of the parts; the other flags are not heeded then."""
    eye: tuple[float, float, float] = FRONT_EYE_W
    """Position of the camera [m]."""
    target: tuple[float, float, float] = FRONT_TARGET_W
    """Point that is seen in the middle [m]."""
    fovy: float = float(np.degrees(FRONT_FOVY_RAD))
    """Angle of view, from top to bottom [deg]."""

    def __post_init__(self) -> None:
        """Refuse what is no camera."""
        if not 1.0 <= self.fovy <= 170.0:
            raise ConfigError(f"--camera.fovy is {self.fovy:g} degrees; it must lie in [1, 170]")

    def camera(self, width_px: int, height_px: int) -> Camera:
        """The camera of pictures of this size.

        Raises:
            ConfigError: The file is no camera, or of pictures of another shape.
        """
        if self.file is not None:
            return _fitting(camera_in(self.file), width_px, height_px, self.file)
        return pinhole(
            width_px=width_px,
            height_px=height_px,
            fovy_rad=float(np.radians(self.fovy)),
            T_wc=look_at(self.eye, self.target),
        )


def camera_in(path: Path) -> Camera:
    """The camera that a JSON file says.

    Raises:
        ConfigError: It says none.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
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
        focal = [_finite(content, name) for name in ("fx_px", "fy_px")]
        middle = [_finite(content, name) for name in ("cx_px", "cy_px")]
        return Camera(
            width_px=sizes[0],
            height_px=sizes[1],
            fx_px=focal[0],
            fy_px=focal[1],
            cx_px=middle[0],
            cy_px=middle[1],
            T_wc=T_oc,
        )
    except RecursionError:
        raise ConfigError(f"--camera.file {path}: is nested too deeply; give a camera") from None
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        told = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise ConfigError(
            f"--camera.file {path}: not a camera ({told}); it holds width_px, height_px, fx_px, "
            "fy_px, cx_px, cy_px and T_oc"
        ) from None


def _finite(content: Mapping[str, Any], name: str) -> float:
    value = float(content[name])
    if not math.isfinite(value):
        raise ValueError(f"{name} is {value}")
    return value


def _fitting(camera: Camera, width_px: int, height_px: int, path: Path) -> Camera:
    factor = width_px / camera.width_px
    if abs(camera.height_px * factor - height_px) > 2.0:
        raise ConfigError(
            f"--camera.file {path}: is for {camera.width_px}x{camera.height_px} px, and what is "
            f"shown has {width_px}x{height_px}; give the camera of this clip or picture"
        )
    return camera if width_px == camera.width_px else camera.scaled(factor)
