"""Interview: typed questions to a model, and a record of all that was said.

Answers that fit are kept on disk by a hash of model, words, pictures and schema, so that the same
question is asked once. An answer that does not fit is sent back once, with what is wrong.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TypeVar

from articulate.cache import touch
from articulate.files import write_json
from articulate.reconstruct.actors.protocol import TraceStep
from articulate.reconstruct.actors.vlm.model import Model, Picture, Reply, Request
from articulate.reconstruct.actors.vlm.schema import Unfit, decoded

T = TypeVar("T")
ANSWERS = "answers"
"""Folder of the cache."""
ASKS = 2
"""Times that a question is asked until an answer fits."""


@dataclass(kw_only=True)
class ModelSession:
    """Asks one model."""

    model: Model
    cache: Path | None
    """Where answers are kept; None: nowhere."""
    steps: list[TraceStep] = field(default_factory=list)
    """Every question with its answer."""
    calls: int = 0
    """Questions that went out: those answered from the cache do not count."""

    def ask(self, request: Request, cls: type[T], check: Callable[[T], str] | None = None) -> T:
        """The model's answer.

        Args:
            request: The question; its schema is that of ``cls``.
            cls: What the answer is decoded into.
            check: Says what is wrong with an answer of the right type; empty if nothing is.

        Raises:
            Unfit: No answer fits.
            UsageError: The model cannot be asked.
        """
        for k in range(ASKS):
            path = self._path(request)
            reply = _kept(path) or self._asked(request)
            try:
                answer = decoded(cls, reply.text)
                wrong = "" if check is None else check(answer)
            except Unfit as unfit:
                wrong = str(unfit)
            self.steps.append(_step(request, reply, wrong))
            if not wrong:
                if path is not None and not reply.kept:
                    write_json(path, asdict(reply))
                return answer
            if k + 1 < ASKS:
                request = request.after(reply.text, f"{wrong}. Answer again, by the schema.")
        raise Unfit(f"{self.model.name}: {ASKS} answers in a row do not fit; {wrong}")

    def _asked(self, request: Request) -> Reply:
        self.calls += 1
        return self.model.ask(request)

    def _path(self, request: Request) -> Path | None:
        if self.cache is None:
            return None
        return self.cache / ANSWERS / f"{request.key(self.model.source)}.json"


def _kept(path: Path | None) -> Reply | None:
    """The answer in ``path``, if there is a whole one."""
    if path is None:
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        reply = Reply(**{**content, "kept": True})
    except (OSError, ValueError, TypeError):
        return None
    touch(path)
    return reply


def _step(request: Request, reply: Reply, wrong: str) -> TraceStep:
    """The last turn of a question, and its answer; what holds for all turns with the first."""
    last = request.turns[-1]
    text = f"{last.text}\n\nThe answer:\n{reply.text}"
    if len(request.turns) == 1:
        text = f"{request.system}\n\n{text}"
    if wrong:
        text += f"\n\nIt does not fit: {wrong}"
    figures = {"tokens in": float(reply.tokens_in), "tokens out": float(reply.tokens_out)}
    return TraceStep(
        title=f"{request.title}: {reply.model}{', kept from an earlier run' * reply.kept}",
        text=text,
        figures=figures,
        images={p.caption: p.png for p in last.pieces if isinstance(p, Picture)},
        seconds=0.0 if reply.kept else reply.seconds,
    )
