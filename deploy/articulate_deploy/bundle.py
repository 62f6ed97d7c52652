"""Bundles: read whole into memory, checked, and only then used.

Nothing of a bundle is written to disk before it was checked, and no file is opened by a library
before its SHA-256 was compared with the manifest.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import NoReturn

import numpy as np

from articulate.errors import BundleError, UsageError
from articulate.task.manifest import MANIFEST_FILE, Manifest, decode_manifest
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.randomization_config import FACTORS, MAX_DELAY_STEPS
from articulate_deploy.bundle_files import read_contents
from articulate_deploy.manifest_compatibility import check_fits
from articulate_deploy.npz_arrays import read_tables
from articulate_deploy.onnx_graph import check_graph
from articulate_deploy.scene_references import check_object, check_scene

MAX_MANIFEST = 1_000_000
"""Largest manifest [bytes]; ours have some 20 kB, and objects of hundreds of repairs more."""
MAX_DIGITS = 18
"""Most characters of a whole number in a manifest; all of them fit into 64 bits."""


@dataclass(frozen=True)
class Bundle:
    """A checked bundle."""

    manifest: Manifest
    files: dict[str, bytes]
    """Contents by path, the manifest aside."""
    where: str
    """Where it comes from, for messages."""

    @property
    def policy(self) -> bytes:
        """The ONNX file."""
        return self.files[self.manifest.policy.file]

    @property
    def golden(self) -> bytes:
        """The file of golden pairs."""
        return self.files[self.manifest.golden.file]

    @property
    def draws(self) -> EpisodeParams:
        """What is drawn for the episodes that robots are compared on."""
        return _draws(self)

    def object_assets(self) -> tuple[str, dict[str, bytes]]:
        """Text of the object's URDF, and the meshes that it names, by their paths beside it."""
        path = PurePosixPath(self.manifest.scene.object_file)
        meshes = {
            PurePosixPath(name).relative_to(path.parent).as_posix(): content
            for name, content in self.files.items()
            if PurePosixPath(name).parent == path.parent / "meshes"
        }
        return self.files[str(path)].decode("utf-8"), meshes

    def scene_assets(self) -> tuple[str, dict[str, bytes]]:
        """Text of the scene and the meshes that it names, by their file names."""
        path = PurePosixPath(self.manifest.scene.file)
        folder = path.parent / "meshes"
        meshes = {
            PurePosixPath(name).name: content
            for name, content in self.files.items()
            if PurePosixPath(name).parent == folder
        }
        return self.files[str(path)].decode("utf-8"), meshes


def load_bundle(path: Path) -> Bundle:
    """Read and check the bundle at ``path``, a folder or a zip file.

    Raises:
        BundleError: It is none, was changed, or holds what is not allowed.
    """
    contents = read_contents(path)
    text = contents.pop(MANIFEST_FILE, None)
    if text is None:
        raise BundleError(
            f"{path}: not a bundle, it has no {MANIFEST_FILE}; give what export-policy made"
        )
    if len(text) > MAX_MANIFEST:
        raise BundleError(f"{path}/{MANIFEST_FILE}: larger than {MAX_MANIFEST // 1000} kB")
    manifest = _manifest(text, f"{path}/{MANIFEST_FILE}")
    _check_sums(manifest, contents, path)
    bundle = Bundle(manifest, contents, str(path))
    check_fits(manifest, bundle.where)
    check_graph(bundle.policy, f"{path}/{manifest.policy.file}")
    _check_scene(bundle)
    _check_object(bundle)
    _draws(bundle)
    return bundle


def _manifest(content: bytes, where: str) -> Manifest:
    try:
        text = content.decode("utf-8")
        _check_numbers(text, where)
        return decode_manifest(text, where)
    except UnicodeDecodeError:
        raise BundleError(f"{where}: not text in UTF-8") from None
    except BundleError:
        raise
    except UsageError as error:  # what the parts of a manifest refuse for themselves
        raise BundleError(f"{where}: {error}") from None


def _check_numbers(text: str, where: str) -> None:
    """Refuse numbers that a computer does not hold, such as 1e999; the rest is said elsewhere."""

    def refuse(word: str) -> NoReturn:
        raise BundleError(f"{where}: {word[:20]} is a number too large to be meant")

    def real(word: str) -> float:
        return float(word) if math.isfinite(float(word)) else refuse(word)

    def whole(word: str) -> int:
        return int(word) if len(word) <= MAX_DIGITS else refuse(word)

    with contextlib.suppress(ValueError, RecursionError):
        json.loads(text, parse_float=real, parse_int=whole)


def _check_sums(manifest: Manifest, contents: dict[str, bytes], path: Path) -> None:
    for name in sorted(set(contents) - set(manifest.files)):
        raise BundleError(f"{path}: {name} is not in the manifest; take it out of the bundle")
    for name in sorted(set(manifest.files) - set(contents)):
        raise BundleError(f"{path}: {name} is missing; export it again")
    for name, content in contents.items():
        if hashlib.sha256(content).hexdigest() != manifest.files[name]:
            raise BundleError(f"{path}: {name} was changed after export; export it again")
    scene = manifest.scene
    for name in (
        *(manifest.policy.file, manifest.golden.file, manifest.episodes.file),
        *(scene.file, scene.object_file),
    ):
        if name not in contents:
            raise BundleError(f"{path}: {name} is missing; export it again")


def _check_scene(bundle: Bundle) -> None:
    where = f"{bundle.where}/{bundle.manifest.scene.file}"
    try:
        text, meshes = bundle.scene_assets()
    except UnicodeDecodeError:
        raise BundleError(f"{where}: not text in UTF-8") from None
    check_scene(text, meshes, where)


def _check_object(bundle: Bundle) -> None:
    where = f"{bundle.where}/{bundle.manifest.scene.object_file}"
    try:
        text, meshes = bundle.object_assets()
    except UnicodeDecodeError:
        raise BundleError(f"{where}: not text in UTF-8") from None
    check_object(text, meshes, where)


def _draws(bundle: Bundle) -> EpisodeParams:
    entry = bundle.manifest.episodes
    where, wanted = f"{bundle.where}/{entry.file}", f"{entry.count} draws of this version"
    shape = (entry.count, len(COLUMNS))
    values = read_tables(bundle.files[entry.file], {"values": shape}, where, wanted)["values"]
    if entry.columns != COLUMNS or not np.isfinite(values).all():
        raise BundleError(f"{where}: does not hold {wanted}")
    _check_draws(EpisodeParams(values), where)
    return EpisodeParams(values)


def _check_draws(draws: EpisodeParams, where: str) -> None:
    """Refuse what no range of a draw allows, and a stand-in would not survive."""
    for name in ("delay_steps", "estimate_delay_steps"):
        ticks = draws[name]
        if np.any((ticks < 0.0) | (ticks > MAX_DELAY_STEPS) | (ticks != np.round(ticks))):
            raise BundleError(f"{where}: a {name} is not one of 0 to {MAX_DELAY_STEPS} ticks")
    for name in FACTORS:
        if np.any(draws[name] <= 0.0):
            raise BundleError(f"{where}: a {name} is not above 0")
