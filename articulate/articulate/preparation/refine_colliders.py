"""Make collision shapes as fine as necessary.

Cavities must stay open and visible surfaces must be covered. Shapes that fail these checks are
computed again at a finer resolution as long as that helps; so are shapes that block other parts.
"""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from articulate.assets.asset import Asset
from articulate.assets.check_report import Check
from articulate.checks.cavities import cavity_points, check_cavities
from articulate.checks.coverage import check_coverage
from articulate.checks.model import ObjectModel, load_model
from articulate.conversion.convert import Reading, Shaped, build_asset, write_asset
from articulate.conversion.write_asset import Body, Mimic
from articulate.errors import AssetError
from articulate.formats.config import ConvertConfig
from articulate.geometry.time_budget import UNLIMITED, Budget, spent_s
from articulate.transforms import Array

PASSES = 4
"""Largest number of passes."""
MIN_PASSES = 3
"""Smallest number of passes. The second finer pass halves the tolerance of shapes once more, and
opens cavities that the first one hardly changed."""
MORE = 2.0
"""Expected gain of a pass relative to that of the previous one: the fourth pass over a bucket with
thin walls gained more than the third."""
PASS_S = 75.0
"""Processor time of a finer pass for each refined link [s] ..."""
MAX_REFINE_S = 200.0
"""... and of all passes together; links that are not reached stay unchanged."""


@dataclass(frozen=True, kw_only=True)
class Refined:
    """Object with the best shapes found."""

    asset: Asset
    bodies: list[Body]
    mimics: list[Mimic]
    model: ObjectModel | None
    """Compiled with its visual geometry; None if it cannot be loaded."""
    unfinished: frozenset[str]
    """Links of which a refinement took too long."""


def refined(reading: Reading, config: ConvertConfig, name: str) -> Refined:
    """Build the object of ``reading`` and refine links while a pass gains enough.

    Args:
        reading: Input.
        config: Options of the conversion.
        name: Name of its folder.
    """
    return Refiner(reading=reading, config=config, name=name).best()


class Refiner:
    """Builds one object with a requested fineness for each link.

    Args:
        reading: Input.
        config: Options of the conversion.
        name: Name of its folder.
    """

    def __init__(self, *, reading: Reading, config: ConvertConfig, name: str) -> None:
        self.reading = reading
        self.config = config
        self.name = name
        self._read = reading.source.repairs.messages
        self._shaped = Shaped()
        self._hollow: dict[str, Array] = {}
        self._times: dict[str, int] = {}
        self._left_s = MAX_REFINE_S

    def best(self) -> Refined:
        """Return the object, with links refined while a pass gains enough."""
        history: dict[str, list[float]] = {}
        times = self._times
        now = self._made(UNLIMITED)
        for left in reversed(range(PASSES)):
            if now.model is None:
                return now
            failed = failed_shapes(now.model)
            short = shortfalls(failed)
            for link in set(short) | set(times):
                if len(history.get(link, ())) == times.get(link, 0):  # built again, or failed again
                    history.setdefault(link, []).append(short.get(link, 0.0))
            again = sorted(link for link in short if should_refine(history[link], left))
            if not again:
                break
            sealed = {c.subject for c in failed if c.name == "cavities"}
            for link in sorted(sealed - set(self._hollow)):
                self._hollow[link] = cavity_points(now.model, link)
            times |= {link: len(history[link]) for link in again}
            now = self._finer(len(again))
        best = {link: values.index(min(values)) for link, values in history.items()}
        worse = {link: count for link, count in best.items() if count != times.get(link, 0)}
        if worse:
            times |= worse
            now = self._made(UNLIMITED)
        return now

    def finer(self, links: Collection[str]) -> Refined | None:
        """Return the object with finer ``links``; None if a check on shapes fails then.

        For parts whose shapes interfere where the authored parts pass.
        """
        before = dict(self._times)
        self._times |= {link: before.get(link, 0) + 1 for link in links}
        now = self._finer(len(links))
        if now.model is not None and not failed_shapes(now.model):
            return now
        self._times = before
        return None

    def _finer(self, count: int) -> Refined:
        """Build the object with the requested fineness, ``count`` links finer than before."""
        start_s = spent_s()
        now = self._made(Budget(min(PASS_S * count, self._left_s)))
        self._left_s = max(self._left_s - (spent_s() - start_s), 0.0)
        return now

    def _made(self, budget: Budget) -> Refined:
        repairs = self.reading.source.repairs
        repairs.restore(self._read)
        finer = [link for link in sorted(self._times) for _ in range(self._times[link])]
        own = replace(self.config, finer=(*self.config.finer, *finer))
        asset, bodies, mimics = build_asset(self.reading, own, self._shaped, self._hollow, budget)
        with tempfile.TemporaryDirectory(prefix="articulate-") as temporary:
            first = write_asset(asset, bodies, mimics, Path(temporary) / self.name)
            try:
                model = load_model(first)
            except AssetError:  # the check "loads" reports it
                model = None
        return Refined(
            asset=asset,
            bodies=bodies,
            mimics=mimics,
            model=model,
            unfinished=frozenset(self._shaped.unfinished),
        )


def failed_shapes(model: ObjectModel) -> list[Check]:
    """Return the failed checks on collision shapes."""
    return [c for c in (*check_cavities(model), *check_coverage(model)) if c.outcome == "failed"]


def shortfalls(failed: Sequence[Check]) -> dict[str, float]:
    """Return the largest difference between limit and measurement of each link."""
    short: dict[str, float] = {}
    for check in failed:
        missing = (check.allowed or 0.0) - (check.measured or 0.0)
        short[check.subject] = max(short.get(check.subject, 0.0), missing)
    return short


def should_refine(history: Sequence[float], left: int) -> bool:
    """Return whether to refine a link once more.

    Args:
        history: Shortfall after each pass. Each remaining pass is expected to gain at most
            ``MORE`` times what the previous one did.
        left: Number of remaining passes.
    """
    if left == 0 or len(history) < MIN_PASSES:
        return left > 0
    return history[-1] <= MORE * left * (history[-2] - history[-1])
