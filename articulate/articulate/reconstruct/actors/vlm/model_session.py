"""Typed requests to a model, with a cache of answers and a trace of the conversation.

Valid answers are cached by a hash of model, texts, images and schema. After an invalid answer the
request is sent once more, with the error.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TypeVar

from articulate.cache import touch
from articulate.errors import shorten
from articulate.files import write_json
from articulate.reconstruct.actors.protocol import TraceStep
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Model, Reply, Request
from articulate.reconstruct.actors.vlm.schema import MAX_ERROR, AnswerError, decode_answer

T = TypeVar("T")
ANSWERS = "answers"
"""Folder of the cache."""
MAX_ATTEMPTS = 2
"""Most requests until an answer is valid."""


@dataclass(kw_only=True)
class ModelSession:
    """Sends requests to one model."""

    model: Model
    cache: Path | None
    """Folder for answers; None: no cache."""
    steps: list[TraceStep] = field(default_factory=list)
    """Every request with its answer."""
    calls: int = 0
    """Requests that were sent; answers from the cache do not count."""

    def generate(
        self, request: Request, cls: type[T], check: Callable[[T], str] | None = None
    ) -> T:
        """Return the decoded answer of the model.

        Args:
            request: Request whose schema is that of ``cls``.
            cls: Type of the answer.
            check: Function that returns the error of an answer; empty if it is valid.

        Raises:
            AnswerError: No answer is valid.
            UsageError: The request cannot be sent.
        """
        for k in range(MAX_ATTEMPTS):
            path = self._path(request)
            reply = _read_reply(path) or self._send(request)
            try:
                answer = decode_answer(cls, reply.text)
                error = "" if check is None else check(answer)
            except AnswerError as invalid:
                error = str(invalid)
            self.steps.append(_step(request, reply, error))
            if not error:
                if path is not None and not reply.cached:
                    write_json(path, asdict(reply))
                return answer
            if k + 1 < MAX_ATTEMPTS:
                request = request.after(reply.text, f"{error}. Answer again, by the schema.")
        reason = shorten(error, MAX_ERROR)
        raise AnswerError(f"{self.model.name}: {MAX_ATTEMPTS} invalid answers in a row; {reason}")

    def _send(self, request: Request) -> Reply:
        self.calls += 1
        return self.model.generate(request)

    def _path(self, request: Request) -> Path | None:
        if self.cache is None:
            return None
        return self.cache / ANSWERS / f"{request.key(self.model.source)}.json"


def _read_reply(path: Path | None) -> Reply | None:
    """Read a cached reply; None if the file is absent or invalid."""
    if path is None:
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        reply = Reply(**{**content, "cached": True})
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    touch(path)
    return reply


def _step(request: Request, reply: Reply, error: str) -> TraceStep:
    """Record the last message of a request and its answer; the system prompt with the first."""
    last = request.turns[-1]
    text = f"{last.text}\n\nThe answer:\n{reply.text}"
    if len(request.turns) == 1:
        text = f"{request.system}\n\n{text}"
    if error:
        text += f"\n\nInvalid: {error}"
    figures = {"tokens in": float(reply.tokens_in), "tokens out": float(reply.tokens_out)}
    return TraceStep(
        title=f"{request.title}: {reply.model}{', cached' * reply.cached}",
        text=text,
        figures=figures,
        images={p.caption: p.png for p in last.content if isinstance(p, CaptionedImage)},
        seconds=0.0 if reply.cached else reply.seconds,
    )
