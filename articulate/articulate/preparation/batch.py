"""Many objects, each in a process of its own, so that none can take the others with it."""

from __future__ import annotations

import filecmp
import html
import signal
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from articulate.assets.check_report import CheckReport
from articulate.errors import UsageError
from articulate.files import write_text
from articulate.jobs.process_pool import Answer, ProcessPool
from articulate.preparation import store
from articulate.preparation.check_report_file import CHECK_REPORT_FILE, load_check_report

SUFFIXES = (".urdf", ".xml", ".mjcf")
NOT_OBJECTS = {"package.xml"}
"""Files of these names lie beside robots and describe none."""
USAGE_EXIT = 2
MOST_DEEP = 8
"""Folders are searched down to this depth."""


@dataclass(frozen=True, kw_only=True)
class Item:
    """One object to be checked."""

    name: str
    """Its name in the batch, unique, with / between folders."""
    file: Path
    """URDF or MJCF file, or an asset folder."""


@dataclass(frozen=True, kw_only=True)
class Checked:
    """What came of one object."""

    item: Item
    check_report: CheckReport
    folder: Path
    """Where asset, proof and page lie."""


def items_in(source: Path, out: Path | None = None) -> tuple[list[Item], bool]:
    """Objects in ``source``, and whether it is one object rather than a folder of them.

    A file is one object; so are an asset folder and a folder with exactly one URDF, or without
    URDFs exactly one MJCF file. In other folders every such file and folder is one, but for what
    lies in ``out`` below them, where results of such a folder are.

    Raises:
        UsageError: ``source`` does not exist, or there is nothing in it.
    """
    if not is_there(source):
        raise UsageError(
            f"{source}: does not exist; give a URDF, an MJCF file or a folder with objects"
        )
    if not source.is_dir():
        if not source.is_file():
            raise UsageError(
                f"{source}: is neither a file nor a folder; give a URDF, an MJCF file or a folder"
            )
        return [Item(name=source.stem, file=source)], True
    one = _one_in(source)
    if one is not None:
        return [Item(name=source.resolve().name, file=one)], True
    found = _named_apart(sorted(_walk(source, source, 0, out), key=lambda item: item.name))
    if not found:
        raise UsageError(f"{source}: holds no .urdf, .xml or asset folder; give another folder")
    return found, False


def _named_apart(items: Sequence[Item]) -> list[Item]:
    """``items`` with ``_`` added where two have one name, or one lies in the other's folder.

    ``cab.urdf`` beside a folder ``cab`` of objects would have its result around theirs.
    """
    folders = {str(parent) for item in items for parent in PurePosixPath(item.name).parents}
    found: dict[str, Item] = {}
    for item in items:
        name = item.name
        while name in found or name in folders:
            name += "_"
        found[name] = Item(name=name, file=item.file)
    return list(found.values())


def is_there(path: Path) -> bool:
    """Whether ``path`` leads to something.

    Raises:
        UsageError: The system cannot tell: a name is too long, or a folder on the way is closed.
    """
    try:
        return path.exists()
    except OSError as error:
        raise UsageError(
            f"{path}: cannot be looked up ({error.strerror}); give another path"
        ) from None


def _one_in(folder: Path) -> Path | None:
    """The one object that ``folder`` is or holds, or None."""
    if (folder / "asset.json").is_file():
        return folder
    files = _files(folder)
    urdfs = [path for path in files if path.suffix.lower() == ".urdf"]
    found = urdfs or files
    return found[0] if len(found) == 1 else None


def _files(folder: Path) -> list[Path]:
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and path.name not in NOT_OBJECTS and path.is_file()
    )


def _walk(folder: Path, top: Path, depth: int, out: Path | None) -> Iterator[Item]:
    if depth and out is not None and folder.resolve() == out.resolve():
        return
    one = _one_in(folder)
    if one is not None:
        yield Item(name=folder.relative_to(top).as_posix(), file=one)
        return
    for path in _files(folder):
        yield Item(name=path.relative_to(top).with_suffix("").as_posix(), file=path)
    for path in sorted(folder.iterdir()):
        hidden = path.name.startswith(".") or path.is_symlink()
        if path.is_dir() and not hidden and depth < MOST_DEEP:
            yield from _walk(path, top, depth + 1, out)


@dataclass(frozen=True, kw_only=True)
class Trouble:
    """Why a child process made nothing."""

    reason: str
    lasting: bool = True
    """It would happen again."""


@dataclass(kw_only=True)
class Batch:
    """Checks objects side by side; what was checked before is taken from the cache."""

    out: Path
    """Folder for one object, or for a folder for each."""
    cache: Path
    options: Mapping[str, Any]
    """Configuration of the conversion, as far as it was given."""
    limit_s: float
    """An object that takes longer is refused [s]."""
    single: bool
    """There is one object, which goes straight into ``out``."""
    fresh: bool = False
    """Check anew what was checked before."""
    _children: ProcessPool = field(init=False)

    def __post_init__(self) -> None:
        self._children = ProcessPool("articulate.preparation.child", self.limit_s)

    def run(self, items: Sequence[Item], jobs: int) -> Iterator[Checked]:
        """Check all ``items``, ``jobs`` at a time, and yield results as they come."""
        yield from self._children.side_by_side(items, self.one, jobs)

    def one(self, item: Item) -> Checked:
        """Check one object and hand its folder over.

        Raises:
            UsageError: The options are not accepted, or the output cannot be written.
        """
        out = self.out if self.single else self.out / item.name
        store.check_out(out)
        found = None if self.fresh else store.find(item.file, self.options, self.cache)
        if found is None:
            found = self._made(item)
        if not _is_there(found, out):
            store.hand_over(found, out)
        return Checked(item=item, check_report=load_check_report(out), folder=out)

    def _made(self, item: Item) -> Path:
        """Folder of the cache with a result that was made now, be it a refusal."""
        file = str(item.file.resolve())
        made = self._child({"file": file})
        if isinstance(made, Path):
            return made
        reason = f"{item.file}: {made.reason}"
        again = self._child({"file": file, "refusal": reason, "lasting": made.lasting})
        if isinstance(again, Path):
            return again
        raise UsageError(f"{reason}; and the refusal could not be written: {again.reason}")

    def _child(self, request: Mapping[str, Any]) -> Path | Trouble:
        """Folder that a child process made, or what became of it."""
        content = {"cache": str(self.cache.resolve()), "options": dict(self.options), **request}
        return _outcome(self._children.ask(content), self.limit_s)


def _outcome(answer: Answer, limit_s: float) -> Path | Trouble:
    """What a child that has ended leaves behind."""
    if answer.code is None:
        reason = f"took longer than {limit_s:g} s; give it more with --limit"
        return Trouble(reason=reason, lasting=False)
    if answer.code == 0:
        folder = Path((answer.told.strip().splitlines() or [""])[-1])
        return folder if (folder / CHECK_REPORT_FILE).is_file() else Trouble(reason="left no proof")
    if answer.code == USAGE_EXIT:
        raise UsageError(answer.last_words)
    if answer.code > 0:
        return Trouble(reason=f"its process ended with {answer.code}: {answer.last_words}")
    if -answer.code == signal.SIGKILL:
        return Trouble(reason="its process was killed; was there enough memory?", lasting=False)
    return Trouble(
        reason=f"a library crashed on it ({answer.signal_name}); "
        "look for a damaged file among its own"
    )


def _is_there(folder: Path, out: Path) -> bool:
    """Whether ``out`` holds the result in ``folder`` already, every file of it unchanged."""
    try:
        own, there = (
            {path.relative_to(top): path for path in top.rglob("*") if path.is_file()}
            for top in (folder, out)
        )
        return own.keys() == there.keys() and all(
            filecmp.cmp(path, there[name], shallow=False) for name, path in own.items()
        )
    except OSError:
        return False


def write_junit(results: Sequence[Checked], path: Path) -> None:
    """Write a JUnit report with a test case for each object, whole or not at all."""
    refused = sum(not r.check_report.is_usable for r in results)
    seconds = sum(r.check_report.seconds for r in results)
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f'<testsuite name="check-asset" tests="{len(results)}" failures="{refused}" '
        f'errors="0" skipped="0" time="{seconds:.3f}">',
    ]
    for r in results:
        case = f'  <testcase classname="check-asset" name={_quoted(r.item.name)} '
        case += f'time="{r.check_report.seconds:.3f}"'
        if r.check_report.is_usable:
            lines.append(f"{case}/>")
            continue
        reasons = _quoted("\n".join(r.check_report.reasons))
        lines += [f"{case}>", f"    <failure message={reasons}/>", "  </testcase>"]
    write_text(path, "\n".join([*lines, "</testsuite>"]) + "\n")


def _quoted(text: str) -> str:
    """An XML attribute without what XML cannot hold."""
    shown = "".join(c for c in text if c.isprintable() or c in "\n\t")
    # xml.sax.saxutils would bring an HTTP client with it.
    return f'"{html.escape(shown)}"'.replace("\n", "&#10;").replace("\t", "&#9;")
