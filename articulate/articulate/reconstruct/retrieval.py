"""Retrieval of an object of a library from one image with an unknown camera.

An index holds renders of each object from a ring of cameras, as features of an ImageNet network and
as silhouettes. The rank of an object is that of its most similar view.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.errors import UsageError
from articulate.files import atomic_write
from articulate.npz_file import read_npz
from articulate.reconstruct.recognition.classifier import classify
from articulate.reconstruct.recognition.mask import crop_on_white
from articulate.render.camera import Camera, look_at, pinhole
from articulate.render.parts import PartMesh, joint_bounds
from articulate.render.raster import Pixels
from articulate.render.scene import NO_PART, PartScene
from articulate.transforms import Array
from articulate.untrusted import read_bounded

Mask = NDArray[np.bool_]
AZIMUTHS_DEG, ELEVATIONS_DEG = (-50.0, -25.0, 0.0, 25.0, 50.0), (10.0, 35.0)
"""Cameras of the index; the front of an object is +x."""
FOV_RAD = float(np.radians(30.0))
SIDE_PX = 224
SILHOUETTE_PX = 48
"""Side of a stored silhouette, whose box fills the larger side."""
SILHOUETTE_WEIGHT = 1.0
"""Weight of the overlap of silhouettes beside the cosine of features."""
MAX_ENTRY_BYTES = 1_000_000
"""Largest entry of an index; it has about 30 kB."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An object of the index."""

    object_id: str
    score: float
    """Cosine of the features plus weighted overlap of the silhouettes."""
    view: int
    """Number of the most similar view."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RetrievalIndex:
    """Renders of the objects of a library."""

    ids: tuple[str, ...]
    features: Array
    """Features (N, V, 1280), of unit length."""
    silhouettes: Mask
    """Silhouettes (N, V, 48, 48)."""

    def rank(self, image: Pixels, mask: Mask, exclude: Collection[str] = ()) -> list[Candidate]:
        """Return the objects from the most similar to the least.

        Args:
            image: Colours (H, W, 3), 0 to 255.
            mask: Pixels of the object (H, W).
            exclude: Ids that are left out.

        Raises:
            UsageError: The mask is empty, no object remains, or the network is not installed.
        """
        feature, silhouette = describe_views([image], [mask])
        kept = [k for k, object_id in enumerate(self.ids) if object_id not in exclude]
        if not kept:
            raise UsageError("no object of the index remains; exclude fewer")
        mean = self.features[kept].mean(axis=(0, 1))
        cosine = _unit(self.features[kept] - mean) @ _unit(feature[0] - mean)
        common = (self.silhouettes[kept] & silhouette[0]).sum(axis=(2, 3))
        union = (self.silhouettes[kept] | silhouette[0]).sum(axis=(2, 3))
        scores = cosine + SILHOUETTE_WEIGHT * common / np.maximum(union, 1)
        views = scores.argmax(axis=1)
        best = scores[np.arange(len(kept)), views]
        order = np.argsort(-best, kind="stable")
        return [
            Candidate(object_id=self.ids[kept[i]], score=float(best[i]), view=int(views[i]))
            for i in order
        ]


def describe_views(images: Sequence[Pixels], masks: Sequence[Mask]) -> tuple[Array, Mask]:
    """Return unit features (N, 1280) and silhouettes (N, 48, 48) of objects in images.

    Raises:
        UsageError: A mask is empty.
    """
    crops = [crop_on_white(image, mask) for image, mask in zip(images, masks, strict=True)]
    silhouettes = np.zeros((len(images), SILHOUETTE_PX, SILHOUETTE_PX), dtype=np.bool_)
    for k, mask in enumerate(masks):
        rows, columns = np.nonzero(mask)
        silhouettes[k] = _square(
            mask[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        )
    return _unit(classify(crops)[1]), silhouettes


def _square(mask: Mask) -> Mask:
    """Scale a silhouette into the middle of a square (48, 48)."""
    height, width = mask.shape
    factor = SILHOUETTE_PX / max(height, width)
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    small = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.5
    out = np.zeros((SILHOUETTE_PX, SILHOUETTE_PX), dtype=np.bool_)
    top, left = (SILHOUETTE_PX - size[1]) // 2, (SILHOUETTE_PX - size[0]) // 2
    out[top : top + size[1], left : left + size[0]] = small
    return out


def _unit(values: Array) -> Array:
    return np.asarray(values / np.maximum(np.linalg.norm(values, axis=-1, keepdims=True), 1e-9))


def render_views(parts: Sequence[PartMesh]) -> tuple[list[Pixels], list[Mask]]:
    """Render an object from each camera of the index: colours and masks (224, 224)."""
    scene = PartScene(parts)
    low, high = joint_bounds(parts)
    images, masks = [], []
    for camera in _cameras(0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))):
        images.append(scene.render_image(camera))
        masks.append(scene.rasterize(camera).part_ids != NO_PART)
    return images, masks


def _cameras(centre: Array, radius: float) -> Iterator[Camera]:
    """Yield cameras that see a sphere."""
    distance = radius / np.sin(0.5 * FOV_RAD)
    for elevation in np.radians(ELEVATIONS_DEG):
        for azimuth in np.radians(AZIMUTHS_DEG):
            level = np.cos(elevation)
            towards = np.array(
                [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
            )
            yield pinhole(
                width_px=SIDE_PX,
                height_px=SIDE_PX,
                fovy_rad=FOV_RAD,
                T_wc=look_at(centre + distance * towards, centre),
            )


def write_entry(path: Path, parts: Sequence[PartMesh]) -> None:
    """Write the entry of one object: ``features`` (V, 1280) and ``silhouettes`` (V, 48, 48)."""
    features, silhouettes = describe_views(*render_views(parts))
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(
            stream, features=features.astype(np.float16), silhouettes=np.packbits(silhouettes)
        )


def read_index(entries: dict[str, Path]) -> RetrievalIndex:
    """Read the entries of several objects by id.

    Raises:
        UsageError: There is none, or one is not an entry.
    """
    if not entries:
        raise UsageError("the index holds no object")
    views = len(AZIMUTHS_DEG) * len(ELEVATIONS_DEG)
    shape = (views, SILHOUETTE_PX, SILHOUETTE_PX)
    features, silhouettes = [], []
    for path in entries.values():
        try:
            file = read_npz(read_bounded(path, MAX_ENTRY_BYTES), MAX_ENTRY_BYTES)
            features.append(file["features"].astype(np.float64).reshape(views, -1))
            bits = np.unpackbits(file["silhouettes"], count=int(np.prod(shape)))
        except (UsageError, TypeError, ValueError, KeyError) as error:
            raise UsageError(
                f"{path.name}: no entry of an index ({type(error).__name__})"
            ) from None
        silhouettes.append(bits.reshape(shape).astype(np.bool_))
    return RetrievalIndex(
        ids=tuple(entries), features=np.stack(features), silhouettes=np.stack(silhouettes)
    )
