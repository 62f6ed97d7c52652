"""Parallel projection of a mesh along x: the visible face and depth of each pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.render.camera import look_at, pinhole
from articulate.render.parts import PartMesh
from articulate.render.scene import PartScene
from articulate.transforms import Array, Ints

SIDE_PX = 320
"""Pixels on the longer side of the object."""
DISTANCE = 60.0
"""Distance of the camera, in diagonals: its rays are parallel to 0.5 degrees."""
BORDER_PX = 2
Z_TO_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation after which the view from above is the front view."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontView:
    """Object seen from +x: columns go with y, rows against z."""

    face: Ints
    """Visible face of each pixel (H, W); -1 for background."""
    depth: Array
    """Coordinate x of the visible surface (H, W) [m]; -inf for background."""
    pixel: float
    """Size of a pixel [m]."""
    origin: Array
    """y and z at the outer corner of pixel (0, 0) (2,) [m]."""

    def window(self, rect: Array) -> tuple[slice, slice]:
        """Return rows and columns whose centres are inside ``(y0, z0, y1, z1)`` (4,) [m]."""
        rows, columns = self.face.shape
        left = int(np.ceil((rect[0] - self.origin[0]) / self.pixel - 0.5))
        right = int(np.floor((rect[2] - self.origin[0]) / self.pixel - 0.5)) + 1
        top = int(np.ceil((self.origin[1] - rect[3]) / self.pixel - 0.5))
        bottom = int(np.floor((self.origin[1] - rect[1]) / self.pixel - 0.5)) + 1
        return (
            slice(min(max(top, 0), rows), min(max(bottom, 0), rows)),
            slice(min(max(left, 0), columns), min(max(right, 0), columns)),
        )

    def rect_of(self, mask: NDArray[np.bool_], rows: slice, columns: slice) -> Array:
        """Return ``(y0, z0, y1, z1)`` (4,) [m] around the true pixels of a window."""
        i, j = np.nonzero(mask)
        top, bottom = rows.start + i.min(), rows.start + i.max() + 1
        left, right = columns.start + j.min(), columns.start + j.max() + 1
        y, z = self.origin
        return np.array(
            [
                y + left * self.pixel,
                z - bottom * self.pixel,
                y + right * self.pixel,
                z - top * self.pixel,
            ]
        )


def front_view(mesh: ScanMesh, side_px: int = SIDE_PX) -> FrontView:
    """Project a mesh along x onto the plane of y and z."""
    centre, size, distance = mesh.bounds.mean(axis=0), mesh.size, DISTANCE * mesh.diagonal
    pixel = float(max(size[1], size[2], 1e-9)) / side_px
    width = int(np.ceil(size[1] / pixel)) + 2 * BORDER_PX
    height = int(np.ceil(size[2] / pixel)) + 2 * BORDER_PX
    eye = centre + np.array([distance, 0.0, 0.0])
    camera = pinhole(
        width_px=width,
        height_px=height,
        fovy_rad=2.0 * float(np.arctan(0.5 * height * pixel / distance)),
        T_wc=look_at(eye, centre),
    )
    part = PartMesh(name="scan", vertices=mesh.vertices, faces=mesh.faces, rgb=mesh.rgb)
    face = PartScene([part]).rasterize(camera).face_ids.astype(np.int64)
    origin = np.array([centre[1] - 0.5 * width * pixel, centre[2] + 0.5 * height * pixel])
    return FrontView(face=face, depth=_depth(mesh, face, origin, pixel), pixel=pixel, origin=origin)


def heights_above(mesh: ScanMesh, box: Array, share: float) -> Array:
    """Return the height of what is seen from above in the middle of a box (N,) [m].

    Args:
        mesh: The object.
        box: Lowest and highest corner (2, 3) [m].
        share: Share of each side of the box that is its middle.

    Returns:
        One height for each pixel; -inf for background.
    """
    view = front_view(mesh.transformed(Z_TO_X, 1.0, np.zeros(3)))
    turned = (box @ Z_TO_X.T)[:, 1:]
    middle, half = turned.mean(axis=0), 0.5 * share * np.abs(np.ptp(turned, axis=0))
    rows, columns = view.window(np.r_[middle - half, middle + half])
    return view.depth[rows, columns].ravel()


def _depth(mesh: ScanMesh, face: Ints, origin: Array, pixel: float) -> Array:
    """Return x where the line through each pixel meets the plane of its face (H, W) [m]."""
    rows, columns = np.indices(face.shape)
    y = origin[0] + (columns + 0.5) * pixel
    z = origin[1] - (rows + 0.5) * pixel
    seen = face >= 0
    which = np.maximum(face, 0)
    normal, corner = mesh.normals[which], mesh.triangles[which]
    slope = np.where(np.abs(normal[..., 0]) < 0.05, np.inf, normal[..., 0])
    offset = normal[..., 1] * (y - corner[..., 0, 1]) + normal[..., 2] * (z - corner[..., 0, 2])
    low, high = corner[..., 0].min(axis=-1), corner[..., 0].max(axis=-1)
    x = np.clip(corner[..., 0, 0] - offset / slope, low, high)
    return np.where(seen, x, -np.inf)
