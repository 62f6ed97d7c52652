"""Bundles: read whole into memory, checked, and only then used.

Nothing of a bundle is written to disk before it was checked, and no file is opened by a library
before its SHA-256 was compared with the manifest.
"""

from __future__ import annotations

import hashlib
import io
import re
import stat
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from articulate.arm import arm_named
from articulate.draw import COLUMNS, Draw
from articulate.errors import BundleError, ConfigError
from articulate.manifest import MANIFEST_FILE, Manifest, decode_manifest, limit_table_sha256
from articulate.observe import ACTION, OBSERVATION
from articulate_deploy.graph import check_graph

MAX_BYTES = 64 << 20
"""Largest size of a bundle, unpacked [bytes]."""
MAX_RATIO = 100
"""Largest ratio of a zip member's size to its packed size."""
MAX_FILES = 2000
"""Largest number of files."""


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
    def draws(self) -> Draw:
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
    if path.is_dir():
        contents = _from_folder(path)
    elif path.is_file():
        contents = _from_zip(path)
    else:
        raise BundleError(f"{path}: no such bundle; export-policy makes one from a run")
    text = contents.pop(MANIFEST_FILE, None)
    if text is None:
        raise BundleError(
            f"{path}: not a bundle, it has no {MANIFEST_FILE}; give what export-policy made"
        )
    try:
        manifest = decode_manifest(text.decode("utf-8"), f"{path}/{MANIFEST_FILE}")
    except UnicodeDecodeError:
        raise BundleError(f"{path}/{MANIFEST_FILE}: not text in UTF-8") from None
    _check_sums(manifest, contents, path)
    bundle = Bundle(manifest, contents, str(path))
    _check_fits(bundle)
    check_graph(bundle.policy, f"{path}/{manifest.policy.file}")
    _check_scene(bundle)
    _check_object(bundle)
    _draws(bundle)
    return bundle


def _from_folder(folder: Path) -> dict[str, bytes]:
    contents: dict[str, bytes] = {}
    total = 0
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        mode = path.lstat().st_mode
        if stat.S_ISDIR(mode):
            continue
        if not stat.S_ISREG(mode):
            raise BundleError(f"{folder}: {name} is not a plain file; a bundle holds no links")
        total += path.stat().st_size
        _check_size(folder, total, len(contents))
        contents[name] = path.read_bytes()
    return contents


def _from_zip(path: Path) -> dict[str, bytes]:
    contents: dict[str, bytes] = {}
    total = 0
    try:
        with zipfile.ZipFile(path) as archive:
            for item in archive.infolist():
                if item.is_dir():
                    _check_name(path, item.filename.rstrip("/"))
                    continue
                _check_member(path, item)
                if item.filename in contents:
                    raise BundleError(f"{path}: {item.filename} stands twice in it")
                total += item.file_size
                _check_size(path, total, len(contents))
                contents[item.filename] = archive.read(item)  # its size is that of the directory
    except (
        zipfile.BadZipFile,
        zlib.error,
        NotImplementedError,
        RuntimeError,
        EOFError,
        OSError,
    ) as error:
        raise BundleError(f"{path}: not a bundle ({error}); give what export-policy made") from None
    return contents


def _check_member(path: Path, item: zipfile.ZipInfo) -> None:
    _check_name(path, item.filename)
    mode = item.external_attr >> 16
    if stat.S_IFMT(mode) not in (0, stat.S_IFREG) or item.flag_bits & 0x1:
        raise BundleError(f"{path}: {item.filename!r} is not a plain file")
    if item.file_size > MAX_RATIO * max(item.compress_size, 100):
        raise BundleError(f"{path}: {item.filename!r} unpacks to more than {MAX_RATIO} times")


def _check_name(path: Path, name: str) -> None:
    parts = name.split("/")
    bad = any(part in {"", ".", ".."} for part in parts) or re.search(r"[\\:\x00-\x1f]", name)
    if bad or len(name) > 200:
        raise BundleError(f"{path}: {name[:60]!r} is no name of a file inside a bundle")


def _check_size(path: Path, total: int, count: int) -> None:
    if total > MAX_BYTES or count >= MAX_FILES:
        raise BundleError(
            f"{path}: larger than a bundle may be ({MAX_BYTES >> 20} MB, {MAX_FILES} files)"
        )


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
        *(manifest.policy.file, manifest.golden.file, manifest.draws.file),
        *(scene.file, scene.object_file),
    ):
        if name not in contents:
            raise BundleError(f"{path}: {name} is missing; export it again")


def _check_fits(bundle: Bundle) -> None:
    """The bundle is for the arm, the observations and the actions of this version."""
    manifest = bundle.manifest
    try:
        arm = arm_named(manifest.robot.name)
    except ConfigError as error:
        raise BundleError(f"{bundle.where}: {error}") from None
    own = limit_table_sha256(arm)
    if manifest.limit_table_sha256 != own or limit_table_sha256(manifest.robot) != own:
        raise BundleError(
            f"{bundle.where}: its limit tables are not those of the {arm.name}; export it again"
        )
    for name, layout, known in (
        ("observation", manifest.observation, OBSERVATION),
        ("action", manifest.action, ACTION),
    ):
        if layout != known:
            fields = [a.name for a, b in zip(layout.fields, known.fields, strict=False) if a != b]
            what = fields[0] if fields else "its number of fields"
            raise BundleError(
                f"{bundle.where}: {name} is not the one of this version ({what}); export it again"
            )


def _check_scene(bundle: Bundle) -> None:
    """The scene refers to nothing but the meshes of the bundle."""
    name = bundle.manifest.scene.file
    try:
        text, meshes = bundle.scene_assets()
    except UnicodeDecodeError:
        raise BundleError(f"{bundle.where}/{name}: not text in UTF-8") from None
    if re.search(r"<[!?]|<\s*(include|plugin|extension|model|hfield|skin|texture)\b", text):
        raise BundleError(f"{bundle.where}/{name}: refers to something outside of the bundle")
    for file in re.findall(r"\bfile\s*=\s*[\"']([^\"']*)[\"']", text):
        if file not in meshes:
            raise BundleError(f"{bundle.where}/{name}: names {file[:60]!r}, which is not in it")
    for folder in re.findall(r"\b(?:mesh|texture|asset)dir\s*=\s*[\"']([^\"']*)[\"']", text):
        if folder != "meshes":
            raise BundleError(f"{bundle.where}/{name}: refers to the folder {folder[:60]!r}")


def _check_object(bundle: Bundle) -> None:
    """The object's URDF refers to nothing but its meshes, and these to nothing at all."""
    name = bundle.manifest.scene.object_file
    try:
        text, meshes = bundle.object_assets()
    except UnicodeDecodeError:
        raise BundleError(f"{bundle.where}/{name}: not text in UTF-8") from None
    if re.search(r"<[!?]|<\s*(gazebo|plugin|sdf|include|texture|visual)\b", text):
        raise BundleError(f"{bundle.where}/{name}: refers to something outside of the bundle")
    for file in re.findall(r"\bfilename\s*=\s*[\"']([^\"']*)[\"']", text):
        if file not in meshes:
            raise BundleError(f"{bundle.where}/{name}: names {file[:60]!r}, which is not in it")
    for file, content in meshes.items():
        if not file.endswith(".obj") or re.search(rb"^\s*[^vf#\s]", content, re.MULTILINE):
            raise BundleError(
                f"{bundle.where}/{PurePosixPath(name).parent / file}: holds more than corners "
                "and faces; export it again"
            )


def _draws(bundle: Bundle) -> Draw:
    entry = bundle.manifest.draws
    where = f"{bundle.where}/{entry.file}"
    try:
        with np.load(io.BytesIO(bundle.files[entry.file]), allow_pickle=False) as arrays:
            values = np.asarray(arrays["values"], dtype=np.float64)
    except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile):
        raise BundleError(f"{where}: not a file of draws") from None
    fits = values.shape == (entry.count, len(COLUMNS)) and entry.columns == COLUMNS
    if not fits or not np.isfinite(values).all():
        raise BundleError(f"{where}: does not hold {entry.count} draws of this version")
    return Draw(values)
