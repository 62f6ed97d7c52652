"""Pinhole camera with a pose.

Axes follow OpenCV: x right, y down, z forward. So do pixel coordinates: the centre of the first
pixel is (0, 0), and points of its trackers need no shift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from articulate.errors import ConfigError
from articulate.transforms import Array, apply, inverse, normalised, pose


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """Intrinsics and pose of a pinhole camera."""

    width_px: int
    height_px: int
    fx_px: float
    """Horizontal focal length [px]."""
    fy_px: float
    """Vertical focal length [px]."""
    cx_px: float
    """Horizontal position of the optical axis [px]."""
    cy_px: float
    """Vertical position of the optical axis [px]."""
    T_wc: Array
    """Pose of the camera in the scene frame (4, 4)."""

    def __post_init__(self) -> None:
        """Reject sizes and focal lengths that are not positive."""
        if min(self.width_px, self.height_px) < 1 or min(self.fx_px, self.fy_px) <= 0.0:
            raise ConfigError(
                f"camera of {self.width_px}x{self.height_px} px with focal lengths {self.fx_px:g} "
                f"and {self.fy_px:g} px; all must be above 0"
            )

    @property
    def T_cw(self) -> Array:
        """Transform from the scene frame to the camera frame (4, 4)."""
        return inverse(self.T_wc)

    @property
    def matrix(self) -> Array:
        """Intrinsic matrix (3, 3), OpenCV's convention."""
        return np.array(
            [[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]]
        )

    @property
    def eye_w(self) -> Array:
        """Position of the camera in the scene frame (3,) [m]."""
        return np.asarray(self.T_wc[:3, 3])

    def project(self, points_w: ArrayLike) -> tuple[Array, Array]:
        """Return pixels (..., 2) [px] and depth (...) [m] of scene points (..., 3) [m].

        Pixels of points behind the camera are NaN.
        """
        points_c = apply(self.T_cw, points_w)
        depth = points_c[..., 2]
        safe = np.where(depth > 0.0, depth, np.nan)
        uv = np.stack(
            [
                self.fx_px * points_c[..., 0] / safe + self.cx_px,
                self.fy_px * points_c[..., 1] / safe + self.cy_px,
            ],
            axis=-1,
        )
        return uv, depth

    def unproject(self, uv: ArrayLike, depth: ArrayLike) -> Array:
        """Return points in the scene frame (..., 3) at pixels (..., 2) [px] and depth (...) [m]."""
        rays = self.rays(uv)
        return apply(self.T_wc, rays * np.asarray(depth, dtype=np.float64)[..., None])

    def rays(self, uv: ArrayLike) -> Array:
        """Return directions in the camera frame (..., 3), with z = 1, of pixels (..., 2) [px]."""
        uv = np.asarray(uv, dtype=np.float64)
        x = (uv[..., 0] - self.cx_px) / self.fx_px
        y = (uv[..., 1] - self.cy_px) / self.fy_px
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def scaled(self, factor: float) -> Camera:
        """Return the same view with ``factor`` times the resolution."""
        width, height = round(self.width_px * factor), round(self.height_px * factor)
        sx, sy = width / self.width_px, height / self.height_px
        return replace(
            self,
            width_px=width,
            height_px=height,
            fx_px=self.fx_px * sx,
            fy_px=self.fy_px * sy,
            cx_px=(self.cx_px + 0.5) * sx - 0.5,
            cy_px=(self.cy_px + 0.5) * sy - 0.5,
        )

    def at(self, T_wc: Array) -> Camera:
        """Return the same camera at another pose ``T_wc`` (4, 4, homogeneous)."""
        return replace(self, T_wc=T_wc)


def pinhole(*, width_px: int, height_px: int, fovy_rad: float, T_wc: Array) -> Camera:
    """Create a camera with square pixels and a vertical field of view ``fovy_rad`` [rad].

    ``T_wc`` (4, 4) is its pose, homogeneous.
    """
    if not 0.0 < fovy_rad < np.pi:
        raise ConfigError(f"field of view of {fovy_rad:g} rad; it must be in (0, pi)")
    focal = 0.5 * height_px / np.tan(0.5 * fovy_rad)
    return Camera(
        width_px=width_px,
        height_px=height_px,
        fx_px=focal,
        fy_px=focal,
        cx_px=0.5 * (width_px - 1),
        cy_px=0.5 * (height_px - 1),
        T_wc=T_wc,
    )


def look_at(eye_w: ArrayLike, target_w: ArrayLike, up_w: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Return the pose ``T_wc`` (4, 4) of a camera at ``eye_w`` that looks at ``target_w`` (3,) [m].

    Raises:
        ConfigError: The view direction is parallel to ``up_w``.
    """
    eye, target = np.asarray(eye_w, dtype=np.float64), np.asarray(target_w, dtype=np.float64)
    ahead = normalised(target - eye)
    right = np.cross(ahead, np.asarray(up_w, dtype=np.float64))
    if np.linalg.norm(right) < 1e-9:
        raise ConfigError(
            f"a camera at {eye.tolist()} cannot look at {target.tolist()}: the view is parallel to "
            "its up direction; choose another"
        )
    right = normalised(right)
    return pose(eye, np.stack([right, np.cross(ahead, right), ahead], axis=-1))


FRONT_EYE_W = (3.0, 1.5, 2.0)
FRONT_TARGET_W = (0.0, 0.0, 0.8)
FRONT_FOVY_RAD = float(np.radians(35.0))


def front_camera(width_px: int = 640, height_px: int = 480) -> Camera:
    """Return the camera of Articulate-Anything's released code.

    It is at (3, 1.5, 2) and looks at (0, 0, 0.8) with a vertical field of view of 35 degrees; the
    object has a size of about two units, is placed on z = 0 and faces +x (github
    vlongle/articulate-anything, ``conf/simulator``).
    """
    return pinhole(
        width_px=width_px,
        height_px=height_px,
        fovy_rad=FRONT_FOVY_RAD,
        T_wc=look_at(FRONT_EYE_W, FRONT_TARGET_W),
    )
