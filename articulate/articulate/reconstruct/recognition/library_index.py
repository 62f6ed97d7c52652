"""Category of an object from renders of the objects of a library that the user has.

Each object is rendered by random cameras on a white background. Features of an ImageNet network are
classified by ridge regression to the categories of the library.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.linalg

from articulate.cache import touch
from articulate.errors import ArticulateError, UsageError
from articulate.files import atomic_write
from articulate.library.partnet import URDF_NAME, PartNetLibrary
from articulate.npz_file import read_npz
from articulate.reconstruct.part_set import library_part_set
from articulate.reconstruct.recognition.classifier import FEATURES, classify
from articulate.reconstruct.recognition.mask import crop_on_white
from articulate.render.parts import PartMesh
from articulate.render.raster import Pixels
from articulate.render.rendered_photo import sample_camera, sample_light
from articulate.render.scene import NO_PART, PartScene
from articulate.transforms import Array
from articulate.untrusted import read_bounded

VIEWS = 8
"""Renders of each object."""
SCALE = 0.5
"""Size of the renders over that of rendered photos."""
VERSION = 1
"""Version of the renders; part of the name of a cached entry."""
RENDERS = "renders"
"""Folder of the cache with one entry for each object."""
MAX_ENTRY_BYTES = 1_000_000
"""Largest entry of the cache that is read; one has about 20 kB."""
URDF_BYTES = 10_000_000
"""Largest URDF of an object."""
RIDGE = 0.2
"""Weight of the squared norm of the regression, for features of unit length."""
TEMPERATURE = 0.07
"""Difference of regressed scores that makes a category more probable by a factor of e."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LibraryIndex:
    """Features of renders of the objects of a library."""

    ids: tuple[str, ...]
    categories: tuple[str, ...]
    """Category of each object, as named by PartNet-Mobility."""
    features: Array
    """Features (N, V, 1280), of unit length."""

    def without(self, exclude: Collection[str]) -> LibraryIndex:
        """Return the index without the objects of these ids.

        Raises:
            UsageError: No object remains.
        """
        kept = [k for k, object_id in enumerate(self.ids) if object_id not in exclude]
        if not kept:
            raise UsageError("no object of the library remains; exclude fewer")
        return LibraryIndex(
            ids=tuple(self.ids[k] for k in kept),
            categories=tuple(self.categories[k] for k in kept),
            features=self.features[kept],
        )

    def category_probabilities(self, feature: Array) -> dict[str, float]:
        """Return the probability of each category of the library from features (1280,)."""
        names, mean, weight, share = self._regression
        unit = feature / max(float(np.linalg.norm(feature)), 1e-9)
        scores = (share + (unit - mean) @ weight) / TEMPERATURE
        values = np.exp(scores - scores.max())
        return dict(zip(names, map(float, values / values.sum()), strict=True))

    @cached_property
    def _regression(self) -> tuple[tuple[str, ...], Array, Array, Array]:
        """Names (C,), mean feature (1280,), weights (1280, C) and share of each category (C,)."""
        names = tuple(sorted(set(self.categories)))
        views = self.features.shape[1]
        x = self.features.reshape(-1, self.features.shape[2])
        chosen = np.repeat([names.index(name) for name in self.categories], views)
        y = np.eye(len(names))[chosen]
        mean, share = x.mean(axis=0), y.mean(axis=0)
        x = x - mean
        normal = x.T @ x + RIDGE * np.eye(x.shape[1])
        return names, mean, scipy.linalg.solve(normal, x.T @ y, assume_a="pos"), share


def open_index(
    folder: Path, cache: Path, progress: Callable[[str], None] = lambda _: None
) -> LibraryIndex:
    """Return the index of a folder of PartNet-Mobility objects; new objects are rendered.

    Objects without a category, and those that cannot be read, are omitted.

    Args:
        folder: Folder with one subfolder for each object.
        cache: Cache folder.
        progress: Called with a line for every hundredth rendered object.

    Raises:
        UsageError: The folder contains no object that can be read, or the package with the weights
            is not installed.
    """
    library = PartNetLibrary(folder)
    found = list(_entries(library, cache, progress))
    if not found:
        raise UsageError(f"{folder}: no object with a category in its meta.json can be read")
    ids, categories, features = zip(*found, strict=True)
    return LibraryIndex(ids=ids, categories=categories, features=np.stack(features))


def _entries(
    library: PartNetLibrary, cache: Path, progress: Callable[[str], None]
) -> Iterator[tuple[str, str, Array]]:
    """Yield id, category and features (V, 1280) of the objects."""
    rendered = 0
    for object_id in library.ids():
        category, folder = library.category(object_id), library.folder / object_id
        if category == "unknown":
            continue
        try:
            path = cache / RENDERS / f"{_key(folder)}.npz"
            features = _read(path)
            crops = [] if features is not None else _views(folder)
        except UsageError:
            continue
        if features is None:
            if rendered % 100 == 0:
                progress(f"{library.folder}: rendering objects of the library, {object_id} …")
            rendered += 1
            features = classify(crops)[1].astype(np.float64)
            features /= np.linalg.norm(features, axis=1, keepdims=True)
            _write(path, features)
        yield object_id, category, features


def _views(folder: Path) -> list[Pixels]:
    """Render an object; the seeds depend on its id, so that cameras differ between objects.

    Raises:
        UsageError: It cannot be read, or a render is empty.
    """
    parts = library_part_set(str(folder)).meshes
    first = int(hashlib.sha256(folder.name.encode()).hexdigest()[:7], 16)
    return [_render(parts, np.random.default_rng(first + k)) for k in range(VIEWS)]


def _render(parts: Sequence[PartMesh], rng: np.random.Generator) -> Pixels:
    """Render an object like ``render_photo``, smaller and on a white background."""
    camera = sample_camera(parts, rng).scaled(SCALE)
    scene = PartScene(parts, sample_light(rng))
    mask = scene.rasterize(camera).part_ids != NO_PART
    return crop_on_white(scene.render_image(camera), mask)


def _key(folder: Path) -> str:
    """Hash the URDF of an object, and name, size and date of its other files."""
    digest = hashlib.sha256(f"renders {VERSION}\0".encode())
    digest.update(read_bounded(folder / URDF_NAME, URDF_BYTES))
    for path in sorted(folder.rglob("*")):
        state = path.lstat()
        line = f"{path.relative_to(folder)}\0{state.st_size}\0{state.st_mtime_ns}\0"
        digest.update(line.encode(errors="surrogateescape"))
    return digest.hexdigest()


def _read(path: Path) -> Array | None:
    """Return the features (V, 1280) of an entry, None if it is absent or damaged."""
    try:
        found = read_npz(read_bounded(path, MAX_ENTRY_BYTES), MAX_ENTRY_BYTES)["features"]
        features = found.astype(np.float64).reshape(VIEWS, FEATURES)
    except (ArticulateError, ValueError, TypeError, KeyError):
        return None
    touch(path)
    return features


def _write(path: Path, features: Array) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary, temporary.open("wb") as stream:
            np.savez(stream, features=features.astype(np.float16))
    except OSError as error:
        raise UsageError(
            f"{path.parent}: cannot be written ({error.strerror}); "
            "set XDG_CACHE_HOME to a folder that can"
        ) from None
