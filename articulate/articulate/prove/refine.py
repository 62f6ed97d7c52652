"""Collision shapes as fine as they have to be, and no finer.

What is hollow has to be open and what is seen has to be covered. Shapes that fail that are made
anew, finer, as long as that helps.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from articulate.asset import Asset
from articulate.convert.budget import UNLIMITED, Budget
from articulate.convert.config import ConvertConfig
from articulate.convert.convert import Reading, Shaped, build_asset, write_asset
from articulate.convert.write import Body, Mimic
from articulate.errors import AssetError
from articulate.proof import Clause
from articulate.prove.coverage import coverage
from articulate.prove.model import ObjectModel, load_model
from articulate.prove.openness import cavity_points, openness
from articulate.transforms import Array

PASSES = 4
"""Shapes are made so often at most."""
PASS_S = 25.0
"""Each finer pass may take so much time of the processor [s]; what is not done by then stays."""


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
    repairs = reading.source.repairs
    read, shaped = repairs.sentences, Shaped()
    hollow: dict[str, Array] = {}
    times: dict[str, int] = {}
    history: dict[str, list[float]] = {}

    def made(budget: Budget) -> Refined:
        repairs.restore(read)
        finer = [link for link in sorted(times) for _ in range(times[link])]
        own = replace(config, finer=(*config.finer, *finer))
        asset, bodies, mimics = build_asset(reading, own, shaped, hollow, budget)
        with tempfile.TemporaryDirectory(prefix="articulate-") as temporary:
            first = write_asset(asset, bodies, mimics, Path(temporary) / name)
            try:
                model = load_model(first)
            except AssetError:  # the clause "loads" says why
                return Refined(asset=asset, bodies=bodies, mimics=mimics, model=None)
        return Refined(asset=asset, bodies=bodies, mimics=mimics, model=model)

    now = made(UNLIMITED)
    for left in reversed(range(PASSES)):
        if now.model is None:
            return now
        failed = [c for c in (*openness(now.model), *coverage(now.model)) if c.outcome == "failed"]
        short = shortfalls(failed)
        for link in set(short) | set(times):
            if len(history.get(link, ())) == times.get(link, 0):  # made anew, or failed anew
                history.setdefault(link, []).append(short.get(link, 0.0))
        again = sorted(link for link in short if is_worth_it(history[link], left))
        if not again:
            break
        for link in sorted({c.subject for c in failed if c.name == "openness"} - set(hollow)):
            hollow[link] = cavity_points(now.model, link)
        times |= {link: len(history[link]) for link in again}
        now = made(Budget(PASS_S))
    best = {link: values.index(min(values)) for link, values in history.items()}
    worse = {link: count for link, count in best.items() if count != times.get(link, 0)}
    if worse:
        times |= worse
        now = made(UNLIMITED)
    return now


def shortfalls(failed: Sequence[Clause]) -> dict[str, float]:
    """How much each link lacks of what failed clauses allow, the most of them."""
    short: dict[str, float] = {}
    for clause in failed:
        lacks = (clause.allowed or 0.0) - (clause.measured or 0.0)
        short[clause.subject] = max(short.get(clause.subject, 0.0), lacks)
    return short


def is_worth_it(history: Sequence[float], left: int) -> bool:
    """Whether to make a link finer once more.

    Args:
        history: What it lacked after each pass; all passes that are left are expected to gain at
            most what the last one did.
        left: Passes that are left.
    """
    if left == 0 or len(history) < 2:
        return left > 0
    return history[-1] <= left * (history[-2] - history[-1])
