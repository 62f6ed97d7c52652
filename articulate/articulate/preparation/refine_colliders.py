"""Collision shapes as fine as they have to be, and no finer.

What is hollow has to be open and what is seen has to be covered. Shapes that fail that are made
anew, finer, as long as that helps; and so are those that stand in the way of others.
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
"""Shapes are made so often at most."""
SURE_PASSES = 3
"""So often they are made in any case: the second finer pass halves what shapes may stray by once
more, and opens what the first one hardly changed."""
MORE = 2.0
"""Each pass that is left may gain so many times what the last one did: the fourth pass over a
bucket of thin walls gained more than the third."""
PASS_S = 75.0
"""A finer pass may take so much time of the processor for each link that it makes finer [s] ..."""
MOST_S = 200.0
"""... and all of them this much; what is not done by then stays as it was."""


@dataclass(frozen=True, kw_only=True)
class Refined:
    """An object with the shapes that were found best."""

    asset: Asset
    bodies: list[Body]
    mimics: list[Mimic]
    model: ObjectModel | None
    """Compiled with what it shows; None if it cannot be loaded."""


def refined(reading: Reading, config: ConvertConfig, name: str) -> Refined:
    """The object of ``reading``, made finer link by link while a pass gains enough.

    Args:
        reading: The source.
        config: What to do otherwise than by default.
        name: Name of a folder for it.
    """
    return Refiner(reading=reading, config=config, name=name).best()


class Refiner:
    """Makes one object, each link as fine as it is asked to be.

    Args:
        reading: The source.
        config: What to do otherwise than by default.
        name: Name of a folder for it.
    """

    def __init__(self, *, reading: Reading, config: ConvertConfig, name: str) -> None:
        self.reading = reading
        self.config = config
        self.name = name
        self._read = reading.source.repairs.sentences
        self._shaped = Shaped()
        self._hollow: dict[str, Array] = {}
        self._times: dict[str, int] = {}
        self._left_s = MOST_S

    def best(self) -> Refined:
        """The object, made finer link by link while a pass gains enough."""
        history: dict[str, list[float]] = {}
        times = self._times
        now = self._made(UNLIMITED)
        for left in reversed(range(PASSES)):
            if now.model is None:
                return now
            failed = failed_shapes(now.model)
            short = shortfalls(failed)
            for link in set(short) | set(times):
                if len(history.get(link, ())) == times.get(link, 0):  # made anew, or failed anew
                    history.setdefault(link, []).append(short.get(link, 0.0))
            again = sorted(link for link in short if is_worth_it(history[link], left))
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
        """The object with ``links`` finer than before; None if a clause on shapes fails then.

        For parts whose shapes go into each other where the parts themselves pass.
        """
        before = dict(self._times)
        self._times |= {link: before.get(link, 0) + 1 for link in links}
        now = self._finer(len(links))
        if now.model is not None and not failed_shapes(now.model):
            return now
        self._times = before
        return None

    def _finer(self, count: int) -> Refined:
        """The object as fine as it is asked to be now, with ``count`` links finer than before."""
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
            except AssetError:  # the clause "loads" says why
                return Refined(asset=asset, bodies=bodies, mimics=mimics, model=None)
        return Refined(asset=asset, bodies=bodies, mimics=mimics, model=model)


def failed_shapes(model: ObjectModel) -> list[Check]:
    """The clauses on shapes that fail."""
    return [c for c in (*check_cavities(model), *check_coverage(model)) if c.outcome == "failed"]


def shortfalls(failed: Sequence[Check]) -> dict[str, float]:
    """How much each link lacks of what failed clauses allow, the most of them."""
    short: dict[str, float] = {}
    for check in failed:
        lacks = (check.allowed or 0.0) - (check.measured or 0.0)
        short[check.subject] = max(short.get(check.subject, 0.0), lacks)
    return short


def is_worth_it(history: Sequence[float], left: int) -> bool:
    """Whether to make a link finer once more.

    Args:
        history: What it lacked after each pass; each pass that is left is expected to gain at
            most ``MORE`` times what the last one did.
        left: Passes that are left.
    """
    if left == 0 or len(history) < SURE_PASSES:
        return left > 0
    return history[-1] <= MORE * left * (history[-2] - history[-1])
