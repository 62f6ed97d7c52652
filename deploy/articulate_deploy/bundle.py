"""Bundles: read into memory, checked, and only then used.

Nothing of a bundle is written to disk, and no library opens a file of it before its SHA-256 is
compared with the manifest.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from articulate.errors import BundleError, UsageError, quote, shorten
from articulate.task.manifest import MANIFEST_FILE, Manifest, decode_manifest
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.randomization_config import FACTORS, MAX_DELAY_STEPS
from articulate.untrusted import parse_json_object
from articulate_deploy.bundle_files import read_contents
from articulate_deploy.manifest_compatibility import check_manifest
from articulate_deploy.npz_arrays import read_tables
from articulate_deploy.onnx_graph import check_graph
from articulate_deploy.scene_references import check_object, check_scene

MAX_MANIFEST = 1_000_000
"""Largest manifest [bytes]; typical ones have 20 kB, those of much repaired objects more."""
MAX_INTEGER = 10**18
"""Largest integer in a manifest; all of them fit into 64 bits."""
MAX_MESSAGE = 600
"""Longest message about a manifest; values of the file may be long."""


@dataclass(frozen=True)
class Bundle:
    """A checked bundle."""

    manifest: Manifest
    files: dict[str, bytes]
    """Contents by path, without the manifest."""
    where: str
    """Path of the bundle, for messages."""

    @property
    def policy(self) -> bytes:
        """ONNX file of the policy."""
        return self.files[self.manifest.policy.file]

    @property
    def golden(self) -> bytes:
        """File of golden pairs."""
        return self.files[self.manifest.golden.file]

    @property
    def episode_params(self) -> EpisodeParams:
        """Sampled parameters of the episodes that robots are compared on."""
        return _episode_params(self)

    def object_assets(self) -> tuple[str, dict[str, bytes]]:
        """Return the text of the object's URDF and its meshes by their paths relative to it."""
        path = PurePosixPath(self.manifest.scene.object_file)
        meshes = {
            PurePosixPath(name).relative_to(path.parent).as_posix(): content
            for name, content in self.files.items()
            if PurePosixPath(name).parent == path.parent / "meshes"
        }
        return self.files[str(path)].decode("utf-8"), meshes

    def scene_assets(self) -> tuple[str, dict[str, bytes]]:
        """Return the text of the scene and its meshes by their file names."""
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
        BundleError: It is not a bundle, was changed, or contains what is not allowed.
    """
    contents = read_contents(path)
    text = contents.pop(MANIFEST_FILE, None)
    if text is None:
        raise BundleError(
            f"{path}: not a bundle, it has no {MANIFEST_FILE}; give one that export-policy made"
        )
    if len(text) > MAX_MANIFEST:
        raise BundleError(f"{path}/{MANIFEST_FILE}: larger than {MAX_MANIFEST // 1000} kB")
    manifest = _manifest(text, f"{path}/{MANIFEST_FILE}")
    _check_sums(manifest, contents, path)
    bundle = Bundle(manifest, contents, str(path))
    check_manifest(manifest, bundle.where)
    check_graph(bundle.policy, f"{path}/{manifest.policy.file}", manifest.golden.count)
    _check_scene(bundle)
    _check_object(bundle)
    _episode_params(bundle)
    return bundle


def _manifest(content: bytes, where: str) -> Manifest:
    try:
        text = content.decode("utf-8")
        _check_integers(parse_json_object(text, where, error=BundleError), where)
        return decode_manifest(text, where)
    except UnicodeDecodeError:
        raise BundleError(f"{where}: not text in UTF-8") from None
    except UsageError as error:  # parts of a manifest raise errors of other classes
        message = str(error) if str(error).startswith(where) else f"{where}: {error}"
        raise BundleError(shorten(message, len(where) + MAX_MESSAGE)) from None


def _check_integers(content: Any, where: str) -> None:
    """Reject integers of more than 64 bits; depth is bounded by the parser."""
    if isinstance(content, int) and abs(content) > MAX_INTEGER:
        raise BundleError(f"{where}: {shorten(content, 20)} is larger than any value of a manifest")
    inside = content.values() if isinstance(content, dict) else content
    if isinstance(content, (dict, list)):
        for value in inside:
            _check_integers(value, where)


def _check_sums(manifest: Manifest, contents: dict[str, bytes], path: Path) -> None:
    for name in sorted(set(contents) - set(manifest.files)):
        raise BundleError(
            f"{path}: {shorten(name)} is not in the manifest; remove it from the bundle"
        )
    for name in sorted(set(manifest.files) - set(contents)):
        raise BundleError(f"{path}: {shorten(name)} is missing; export it again")
    for name, content in contents.items():
        if hashlib.sha256(content).hexdigest() != manifest.files[name]:
            raise BundleError(f"{path}: {shorten(name)} was changed after export; export it again")
    scene = manifest.scene
    for name in (
        *(manifest.policy.file, manifest.golden.file, manifest.episodes.file),
        *(scene.file, scene.object_file),
    ):
        if name not in contents:
            raise BundleError(f"{path}: {quote(name)} is missing; export it again")


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


def _episode_params(bundle: Bundle) -> EpisodeParams:
    entry = bundle.manifest.episodes
    where = f"{bundle.where}/{entry.file}"
    expected = f"the parameters of {entry.count} episodes of this version"
    shape = (entry.count, len(COLUMNS))
    values = read_tables(bundle.files[entry.file], {"values": shape}, where, expected)["values"]
    if entry.columns != COLUMNS or not np.isfinite(values).all():
        raise BundleError(f"{where}: does not hold {expected}")
    _check_params(EpisodeParams(values), where)
    return EpisodeParams(values)


def _check_params(params: EpisodeParams, where: str) -> None:
    """Reject values that no randomization permits and that no simulation would survive."""
    for name in ("delay_steps", "estimate_delay_steps"):
        steps = params[name]
        if np.any((steps < 0.0) | (steps > MAX_DELAY_STEPS) | (steps != np.round(steps))):
            raise BundleError(f"{where}: a {name} is not an integer from 0 to {MAX_DELAY_STEPS}")
    for name in FACTORS:
        if np.any(params[name] <= 0.0):
            raise BundleError(f"{where}: a {name} is not above 0")
