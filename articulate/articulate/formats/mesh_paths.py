"""Find the file that a reference in a URDF, SDF or MJCF means."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from articulate.errors import MAX_QUOTED, AssetError, quote


class MissingMesh(AssetError):  # noqa: N818  # a kind of AssetError, which has the word
    """A mesh that was not found; it may be added later."""


PARENTS = 4
"""Folders above the URDF that are searched for ``package://`` names."""


def resolve(reference: str, urdf: Path, mesh_dirs: tuple[Path, ...] = ()) -> Path:
    """Return the file that ``reference`` names.

    ``package://``, ``model://``, ``file://``, relative, absolute and Windows paths are
    understood; case is ignored where no file matches exactly.

    Args:
        reference: Value of ``filename`` or ``uri``.
        urdf: File that contains it.
        mesh_dirs: Further folders to look in.

    Raises:
        AbsentMesh: Nothing matches; the message lists the folders tried.
    """
    tried: list[Path] = []
    for candidate in _candidates(reference, urdf, mesh_dirs):
        found = _existing(candidate)
        if found is not None:
            return found
        if candidate.parent.resolve() not in (folder.resolve() for folder in tried):
            tried.append(candidate.parent)
    names = [_short(folder, urdf.parent) for folder in tried]
    where = ", ".join([name for name in names if len(name) <= MAX_QUOTED][:8])
    ros = "" if os.environ.get("ROS_PACKAGE_PATH") else ", $ROS_PACKAGE_PATH (unset)"
    raise MissingMesh(
        f"mesh {quote(reference)} not found; looked in {where}{ros}. Put it there, "
        "or name its folder with check-asset --mesh-dirs FOLDER, and train on its --out folder"
    )


def found_elsewhere(reference: str, urdf: Path, found: Path) -> bool:
    """Return whether ``found`` is not at ``reference``; a package may be anywhere."""
    text, packaged = _plain(reference)
    if packaged:
        return not found.as_posix().endswith("/".join(PurePosixPath(text).parts[1:]))
    expected = Path(text) if PurePosixPath(text).is_absolute() else urdf.parent / text
    try:
        return not (expected.is_file() and expected.samefile(found))
    except OSError:
        return True


def _plain(reference: str) -> tuple[str, bool]:
    """Return a path with slashes, and whether its first part names a package."""
    text = unquote(reference.strip()).replace("\\", "/")
    packaged = False
    for scheme in ("package://", "model://"):
        if text.startswith(scheme):
            text, packaged = text[len(scheme) :].lstrip("/"), True
    if text.startswith("file://"):
        text = text[len("file://") :].removeprefix("localhost")
    if len(text) > 1 and text[1] == ":":  # a drive letter
        text = text[2:]
    return text, packaged


def _candidates(reference: str, urdf: Path, mesh_dirs: tuple[Path, ...]) -> Iterator[Path]:
    text, packaged = _plain(reference)
    base = urdf.parent
    path = PurePosixPath(text)
    if not path.name or "\0" in text:
        return
    if path.is_absolute():
        yield Path(path)
        path = path.relative_to(path.anchor)
    inside = PurePosixPath(*path.parts[1:]) if len(path.parts) > 1 else path
    roots = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    if packaged:
        for folder in (base, *list(base.resolve().parents)[:PARENTS]):
            yield folder / path
            if folder.name.lower() == path.parts[0].lower():
                yield folder / inside
        for root in roots:
            yield root / path
            if root.name.lower() == path.parts[0].lower():
                yield root / inside
    else:
        yield base / path
    for folder in (*mesh_dirs, base, base.parent):
        yield folder / path
        yield folder / inside
        yield folder / path.name
        yield folder / "meshes" / path.name


def _existing(path: Path) -> Path | None:
    """Return ``path``, or the only file whose name differs in case."""
    try:
        if path.is_file():
            return path
    except OSError:  # a name that is too long, a folder that is closed
        return None
    current = Path(path.anchor) if path.is_absolute() else Path()
    for part in path.parts[1:] if path.is_absolute() else path.parts:
        step = current / part
        if part != ".." and not step.exists():
            try:
                same = sorted(p for p in current.iterdir() if p.name.lower() == part.lower())
            except OSError:
                return None
            if not same:
                return None
            step = same[0]
        current = step
    return current if current.is_file() else None


def _short(folder: Path, base: Path) -> str:
    try:
        return f"{folder.relative_to(base)}/"
    except ValueError:
        return f"{folder}/"
