"""Check many objects, each in an isolated child process, so that a crash costs one object."""

from __future__ import annotations

import filecmp
import html
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from articulate.assets.check_report import CheckReport
from articulate.errors import UsageError
from articulate.files import write_text
from articulate.formats.find_source import objects_in, source_files
from articulate.jobs.process_pool import ChildResult, run_isolated
from articulate.preparation import store
from articulate.preparation.check_report_file import CHECK_REPORT_FILE, load_check_report

MAX_DEPTH = 8
"""Folders are searched down to this depth."""
MODULE = "articulate.preparation.child"
"""Module that checks one object in a child process."""


@dataclass(frozen=True, kw_only=True)
class Item:
    """One object to check."""

    name: str
    """Its name in the batch, unique, with / between folders."""
    file: Path
    """Object file or asset folder."""


@dataclass(frozen=True, kw_only=True)
class Checked:
    """Check report of one object."""

    item: Item
    check_report: CheckReport
    folder: Path
    """Folder with asset, report and page."""


def items_in(source: Path, out: Path | None = None) -> tuple[list[Item], bool]:
    """Return the objects in ``source``, and whether it is one object rather than a folder of them.

    A file is one object; so are an asset folder and a folder with exactly one URDF, or without
    URDFs exactly one other object file. In other folders every such file and folder is an object,
    except below ``out``, which holds results.

    Raises:
        UsageError: ``source`` does not exist, or there is nothing in it.
    """
    if not path_exists(source):
        raise UsageError(
            f"{source}: does not exist; give a URDF, SDF or MJCF file or a folder with objects"
        )
    if not source.is_dir():
        if not source.is_file():
            raise UsageError(
                f"{source}: is neither a file nor a folder; give a URDF, SDF or MJCF file, or a "
                "folder"
            )
        return [Item(name=source.stem, file=source)], True
    one = _single_object(source)
    if one is not None:
        return [Item(name=source.resolve().name, file=one)], True
    found = _with_unique_names(sorted(_walk(source, source, 0, out), key=lambda item: item.name))
    if not found:
        raise UsageError(
            f"{source}: holds no .urdf, .sdf, .xml or asset folder; give another folder"
        )
    return found, False


def _with_unique_names(items: Sequence[Item]) -> list[Item]:
    """Append ``_`` to names that are used twice or are the folder of another object.

    The result of ``cab.urdf`` beside a folder ``cab`` of objects would enclose their results.
    """
    folders = {str(parent) for item in items for parent in PurePosixPath(item.name).parents}
    found: dict[str, Item] = {}
    for item in items:
        name = item.name
        while name in found or name in folders:
            name += "_"
        found[name] = Item(name=name, file=item.file)
    return list(found.values())


def path_exists(path: Path) -> bool:
    """Return whether ``path`` exists.

    Raises:
        UsageError: The path cannot be looked up, as a name is too long or a folder is closed.
    """
    try:
        return path.exists()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{path}: cannot be looked up ({reason}); give another path") from None


def _single_object(folder: Path) -> Path | None:
    """Return the only object that ``folder`` is or holds, or None."""
    if os.path.lexists(folder / "asset.json"):  # if it is no file, the check rejects it
        return folder
    found = objects_in(folder)
    return found[0] if len(found) == 1 else None


def _walk(folder: Path, top: Path, depth: int, out: Path | None) -> Iterator[Item]:
    if depth and out is not None and folder.resolve() == out.resolve():
        return
    one = _single_object(folder)
    if one is not None:
        yield Item(name=folder.relative_to(top).as_posix(), file=one)
        return
    for path in source_files(folder):
        yield Item(name=path.relative_to(top).with_suffix("").as_posix(), file=path)
    for path in sorted(folder.iterdir()):
        hidden = path.name.startswith(".") or path.is_symlink()
        if path.is_dir() and not hidden and depth < MAX_DEPTH:
            yield from _walk(path, top, depth + 1, out)


@dataclass(kw_only=True)
class Batch:
    """Checks objects in parallel; earlier results are read from the cache."""

    out: Path
    """Folder for one object, or for one folder for each object."""
    cache: Path
    options: Mapping[str, Any]
    """Options of the conversion that differ from the defaults."""
    limit_s: float
    """Processor time after which an object is undecided [s]."""
    single: bool
    """True for one object, whose result is written into ``out`` itself."""
    fresh: bool = False
    """Ignore earlier results."""

    def run(self, items: Sequence[Item], jobs: int) -> Iterator[Checked]:
        """Check all ``items``, ``jobs`` at a time, and yield results as they are ready.

        Raises:
            UsageError: The options are not accepted, or the output cannot be written.
        """
        open_items = []
        for item in items:
            store.check_out(self._out(item))
            found = None if self.fresh else store.load(item.file, self.options, self.cache)
            if found is None:
                open_items.append((item, self._request(item)))
            else:
                yield self._exported(item, found)
        for item, result in run_isolated(MODULE, open_items, jobs, self.limit_s):
            yield self._exported(item, self._made(item, result))

    def one(self, item: Item) -> Checked:
        """Check one object; errors as for :meth:`run`."""
        return next(iter(self.run([item], 1)))

    def _out(self, item: Item) -> Path:
        return self.out if self.single else self.out / item.name

    def _request(self, item: Item) -> dict[str, Any]:
        file, cache = str(item.file.resolve()), str(self.cache.resolve())
        return {"file": file, "cache": cache, "options": dict(self.options)}

    def _made(self, item: Item, result: ChildResult) -> Path:
        """Return the folder of the cache with the result, be it a rejection."""
        reason = result.failure(self.limit_s)
        folder = Path(result.value)
        if not reason and result.value and (folder / CHECK_REPORT_FILE).is_file():
            return folder
        from articulate.preparation.prepare import reject  # MuJoCo; usually not needed here

        if result.code is None:
            reason += "; give it more with --limit"
        return reject(
            item.file.resolve(),
            f"{item.file}: {reason or 'left no check report'}",
            self.options,
            self.cache.resolve(),
            seconds=result.processor_s,
            undecided=result.is_undecided or not reason,
        )

    def _exported(self, item: Item, made: Path) -> Checked:
        out = self._out(item)
        if not _is_same(made, out):
            store.export(made, out)
        return Checked(item=item, check_report=load_check_report(out), folder=out)


def _is_same(folder: Path, out: Path) -> bool:
    """Return whether ``out`` holds the files of ``folder``, all unchanged, and no others."""
    try:
        expected, present = (
            {path.relative_to(top): path for path in top.rglob("*") if path.is_file()}
            for top in (folder, out)
        )
        return expected.keys() == present.keys() and all(
            filecmp.cmp(path, present[name], shallow=False) for name, path in expected.items()
        )
    except OSError:
        return False


def write_junit(results: Sequence[Checked], path: Path) -> None:
    """Write a JUnit report with one test case for each object, completely or not at all."""
    rejected = sum(r.check_report.verdict == "rejected" for r in results)
    undecided = sum(r.check_report.verdict == "undecided" for r in results)
    seconds = sum(r.check_report.seconds for r in results)
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f'<testsuite name="check-asset" tests="{len(results)}" failures="{rejected}" '
        f'errors="{undecided}" skipped="0" time="{seconds:.3f}">',
    ]
    for r in results:
        case = f'  <testcase classname="check-asset" name={_quoted(r.item.name)} '
        case += f'time="{r.check_report.seconds:.3f}"'
        if r.check_report.is_usable:
            lines.append(f"{case}/>")
            continue
        reasons = _quoted("\n".join(r.check_report.reasons))
        kind = "failure" if r.check_report.verdict == "rejected" else "error"
        lines += [f"{case}>", f"    <{kind} message={reasons}/>", "  </testcase>"]
    write_text(path, "\n".join([*lines, "</testsuite>"]) + "\n")


def _quoted(text: str) -> str:
    """Return an XML attribute without the characters that XML cannot hold."""
    printable = "".join(c for c in text if c.isprintable() or c in "\n\t")
    # xml.sax.saxutils would import an HTTP client.
    return f'"{html.escape(printable)}"'.replace("\n", "&#10;").replace("\t", "&#9;")
