"""``check-asset``: convert and check objects."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from articulate.assets.check_report import VERDICTS
from articulate.cache import cache_folder, cache_in_use
from articulate.checks.descriptions import explain, explanation_content
from articulate.commands import console
from articulate.commands.fields import ADVANCED, POSITIONAL
from articulate.commands.flags import parse
from articulate.commands.success import MISSED
from articulate.errors import ConfigError
from articulate.files import require_space
from articulate.preparation.batch import Batch, Checked, Item, items_in, path_exists, write_junit
from articulate.preparation.check_report_file import PAGE_FILE, content_of

MOST_LIMIT_S = 1e6
"""Longest time that an object may be given [s]."""
BAR = 24
"""Width of the progress bar [characters]."""
RESULT_BYTES = 4_000_000
"""Approximate size of the page and the shapes of one object [bytes]."""
NOTE = "note: "
"""Prefix of entries in the list of repairs that change nothing."""
LONGEST = 100
"""Most characters of a reason in the table."""


@dataclass(frozen=True, kw_only=True)
class CheckFlags:
    """Convert a URDF, MJCF or SDF object into a simulation-ready folder, and check it.

    Example: check-asset cabinet.urdf --out checked/cabinet
    """

    asset: Annotated[Path | None, POSITIONAL] = None
    """URDF, MJCF or SDF file, a folder that holds one, an asset folder, or a folder of such."""
    out: Path | None = None
    """Output folder; of several objects each has a subfolder. By default checked/<asset>. An
    earlier result there is replaced; other files are not."""
    jobs: int = 1
    """Number of objects checked in parallel; 0: one for each processor."""
    limit: float = 300.0
    """Processor time after which the check of an object ends as undecided [s]."""
    compare_with: Path | None = None
    """Input file to compare an asset folder with."""
    recheck: bool = False
    """Check again, ignoring the cache."""
    json: bool = False
    """Print only the result, as JSON, on standard output."""
    junit: Annotated[Path | None, ADVANCED] = None
    """Also write the result as JUnit XML to this file."""
    explain: str | None = None
    """Explain a check: meaning, reason and remedy; nothing is checked."""
    size: float | None = None
    """Longest side of the closed object [m]; by default the rule of its category, or as it is."""
    category: str | None = None
    """PartNet-Mobility category, for size and masses; by default read from the source."""
    closed: Literal["auto", "lower", "upper", "zero"] = "auto"
    """Closed position of the joints: a limit, or 0 inside the range; auto: the limit nearer to 0,
    inferred from geometry where 0 is inside the range."""
    up: Literal["z", "y"] = "z"
    """Axis of the file that points up."""
    collada_up: Annotated[Literal["auto", "file", "y"], ADVANCED] = "auto"
    """Up axis of COLLADA meshes with z up: as in the file, or turned to y up as in Assimp; auto:
    turned where doors would otherwise turn in their plane."""
    mesh_dirs: Annotated[tuple[Path, ...], ADVANCED] = ()
    """Further folders with meshes."""
    max_geoms: Annotated[int | None, ADVANCED] = None
    """Largest number of collision geoms of one link."""
    accept: tuple[str, ...] = ()
    """Checks whose failure is only a warning: authored_overlap, for authored parts that run through
    each other although every joint opens and closes."""
    licence: Annotated[str | None, ADVANCED] = None
    """Licence of the object, if the source has none."""

    def __post_init__(self) -> None:
        if self.explain is not None:
            return
        if self.asset is None:
            raise ConfigError("missing: ASSET; give a URDF, an MJCF file or a folder, or --explain")
        if self.jobs < 0:
            raise ConfigError(f"--jobs is {self.jobs}; it must be 0 or more")
        if not self.limit > 0.0:
            raise ConfigError(f"--limit is {self.limit:g} s; it must be above 0")
        if self.limit > MOST_LIMIT_S:
            raise ConfigError(
                f"--limit is {self.limit:g} s; it must be at most {MOST_LIMIT_S:.0f} s"
            )
        if self.max_geoms is not None and self.max_geoms < 1:
            raise ConfigError(f"--max-geoms is {self.max_geoms}; it must be at least 1")

    def options(self) -> dict[str, Any]:
        """Return the options of the conversion that differ from the defaults."""
        options = {
            "against": None if self.compare_with is None else str(self.compare_with.resolve()),
            "size_m": self.size,
            "category": self.category,
            "closed": None if self.closed == "auto" else self.closed,
            "up": None if self.up == "z" else self.up,
            "collada_up": None if self.collada_up == "auto" else self.collada_up,
            "mesh_dirs": [str(path.resolve()) for path in self.mesh_dirs] or None,
            "max_geoms": self.max_geoms,
            "accept": list(self.accept) or None,
            "licence": self.licence,
        }
        return {key: value for key, value in options.items() if value is not None}


FLAGS = CheckFlags


def main(argv: Sequence[str]) -> int:
    """Check and print; 3 if an object was rejected or is undecided."""
    flags = parse(CheckFlags, argv, prog="check-asset")
    if flags.explain is not None:
        if flags.json:
            console.emit_json(explanation_content(flags.explain))
        else:
            console.emit(explain(flags.explain))
        return 0
    assert flags.asset is not None
    from articulate.conversion.metric_size import check_category  # heavy; --help does without

    check_category(flags.category)
    for path in (flags.asset, flags.out, flags.junit):
        if path is not None:
            path_exists(path)  # before any work, where it could not even be looked up
    if flags.compare_with is not None and not path_exists(flags.compare_with):
        raise ConfigError(
            f"--compare-with {flags.compare_with}: does not exist; give a URDF, MJCF or SDF file"
        )
    out = flags.out or Path("checked") / _name(flags.asset)
    items, single = items_in(flags.asset, out)
    _require_of_use(flags, items)
    require_space(out, _need_bytes(flags.asset, len(items)), f"checking {flags.asset}")
    console.hint_after_interrupt("completed checks are kept; the same command continues")
    cache = cache_folder()
    batch = Batch(
        out=out,
        cache=cache,
        options=flags.options(),
        limit_s=flags.limit,
        single=single,
        fresh=flags.recheck,
    )
    jobs = min(flags.jobs or os.cpu_count() or 1, len(items))
    with cache_in_use(cache):
        results = list(_with_progress(batch.run(items, jobs), 0 if single else len(items)))
    results.sort(key=lambda r: [item.name for item in items].index(r.item.name))
    if flags.junit is not None:
        write_junit(results, flags.junit)
    if not single:
        _write_index(results, out / "index.html")
    if flags.json:
        console.emit_json(_content(results, single=single))
    else:
        console.emit(_one(results[0]) if single else _table(results, out / "index.html"))
    return MISSED if any(not r.check_report.is_usable for r in results) else 0


def _require_of_use(flags: CheckFlags, items: Sequence[Item]) -> None:
    """Raise ConfigError for flags without effect on the given kind of object."""
    folders = [item.file.is_dir() for item in items]
    if flags.compare_with is not None and not any(folders):
        raise ConfigError(
            f"--compare-with: {flags.asset} is not an asset folder; only those are compared with "
            "their input: omit it"
        )
    if flags.compare_with is None and all(folders):
        names = [
            name.removesuffix("_m").replace("_", "-")
            for name in flags.options()
            if name != "accept"  # it applies to asset folders as well
        ]
        if names:
            raise ConfigError(
                f"--{names[0]}: {flags.asset} is an asset folder and is checked as it is; give "
                "the file that it was made from"
            )


def _name(asset: Path) -> str:
    """Return the default name of a result: that of the file or folder."""
    return (asset.stem if asset.is_file() else asset.resolve().name) or "objects"


def _need_bytes(asset: Path, count: int) -> int:
    """Estimate the size of ``count`` results, here and in the cache [bytes]."""
    files = (path for path in asset.rglob("*") if path.is_file())  # none below a file
    return 2 * (sum(path.stat().st_size for path in files) + count * RESULT_BYTES)


def _with_progress(results: Iterator[Checked], total: int) -> Iterator[Checked]:
    """Yield the results, with progress on stderr if ``total`` is above 0."""
    counts: Counter[str] = Counter()
    live = console.is_live()
    for done, result in enumerate(results, 1):
        counts[result.check_report.verdict] += 1
        if total and live:
            bar = "#" * (BAR * done // total)
            summary = ", ".join(f"{n} {verdict}" for verdict, n in sorted(counts.items()))
            console.rewrite(f"[{bar:<{BAR}}] {done}/{total}  {summary}  {result.item.name}")
        elif total:
            line = f"{done}/{total} {result.item.name}: {result.check_report.verdict}"
            console.show_progress(f"{line} ({result.check_report.seconds:.1f} s)")
        yield result
    if total and live:
        console.show_progress("")


def _write_index(results: Sequence[Checked], path: Path) -> None:
    from articulate.asset_page.index import (  # MuJoCo; a cached check does without
        IndexRow,
        write_index,
    )

    rows = [
        IndexRow(
            check_report=r.check_report, category=_category(r.folder), page=r.folder / PAGE_FILE
        )
        for r in results
    ]
    write_index(rows, path, title=f"{len(rows)} objects")


def _category(folder: Path) -> str:
    try:
        content = json.loads((folder / "asset.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return "unknown"
    return str(content.get("category", "unknown"))


def _content(results: Sequence[Checked], *, single: bool) -> dict[str, Any]:
    if single:
        return content_of(results[0].check_report)
    counts = Counter(r.check_report.verdict for r in results)
    assets = []
    for r in results:
        content = content_of(r.check_report)
        del content["checks"]
        assets.append({"name": r.item.name, **content})
    return {v: counts[v] for v in VERDICTS} | {"assets": assets}


def _one(result: Checked) -> str:
    """Format the result of one object."""
    check_report = result.check_report
    passed = sum(check.outcome == "passed" for check in check_report.checks)
    tried = sum(check.outcome != "not_applicable" for check in check_report.checks)
    lines = [f"{check_report.asset}: {check_report.verdict}"]
    if tried:
        lines[0] += f" ({passed} of {tried} checks passed, {check_report.seconds:.1f} s)"
    lines += [f"  because  {reason}" for reason in check_report.reasons]
    lines += [
        f"  warning  {check.name} of {check.subject}: {check.message}"
        for check in check_report.checks
        if check.outcome == "warning"
    ]
    lines += [f"  {_mark(repair)}  {repair.removeprefix(NOTE)}" for repair in check_report.repairs]
    for joint in check_report.joints:
        unit = "m" if joint.kind == "slide" else "rad"
        opened = "" if joint.opened is None else f", opened by 30 N {joint.opened:.0%}"
        needs = f", needs {' and '.join(joint.needs)} open" if joint.needs else ""
        limits = "without limits"
        if joint.lower is not None and joint.upper is not None:
            limits = f"limits {joint.lower:.3g} to {joint.upper:.3g}"
        travel = f"{joint.kind} of {abs(joint.span):.3g} {unit} ({limits})"
        lines.append(f"  joint    {joint.name}: {travel}, free {joint.swept:.0%}{opened}{needs}")
    return "\n".join([*lines, f"  page     {result.folder / PAGE_FILE}"])


def _mark(repair: str) -> str:
    return "note   " if repair.startswith(NOTE) else "changed"


def _table(results: Sequence[Checked], index: Path) -> str:
    """Format a line for each object, and the totals."""
    width = max(len(r.item.name) for r in results)
    lines = [f"{'object':<{width}}  verdict    joints  colliders  seconds  why"]
    for r in results:
        p = r.check_report
        why = next(iter(p.reasons or ()), "")
        why = why if len(why) <= LONGEST else f"{why[: LONGEST - 1]}…"
        lines.append(
            f"{r.item.name:<{width}}  {p.verdict:<9}  {len(p.joints):>6}  {p.colliders:>9}  "
            f"{p.seconds:>7.1f}  {why}".rstrip()
        )
    counts = Counter(r.check_report.verdict for r in results)
    summary = ", ".join(f"{counts[v]} {v}" for v in VERDICTS)
    return "\n".join([*lines, f"{len(results)} objects: {summary}", f"page: {index}"])
