"""Typed requests to a model, with a cache of answers and a trace of the conversation.

Answers are cached by a hash of model, texts, images and schema. After an invalid answer, or one
that is cut at the token limit, the request is sent once more, with the error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from articulate.errors import shorten
from articulate.reconstruct.actors.protocol import TraceStep
from articulate.reconstruct.actors.vlm.answer_store import AnswerStore
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Model, Reply, Request
from articulate.reconstruct.actors.vlm.schema import MAX_ERROR, AnswerError, decode_answer

T = TypeVar("T")
MAX_ATTEMPTS = 2
"""Most requests until an answer is valid."""
MAX_ECHO = 20_000
"""Most characters of an invalid answer that are sent back, and that the trace holds."""


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
        store = AnswerStore(self.cache)
        unstored: list[tuple[str, Reply]] = []
        for k in range(MAX_ATTEMPTS):
            key = request.key(self.model.source)
            with store.lock(key):
                reply = store.read(key) or self._send(request)
                answer, error = _decode(cls, reply)
                if answer is not None and check is not None:
                    error = check(answer)
                unstored.append((key, reply))
                if not error or store.keeps_all:
                    for stored_key, stored in unstored:
                        store.write(stored_key, stored)
                    unstored.clear()
            self.steps.append(_step(request, reply, error))
            if answer is not None and not error:
                return answer
            if reply.block_reason:
                raise AnswerError(f"{self.model.name}: sent no answer ({reply.block_reason})")
            if k + 1 < MAX_ATTEMPTS:
                echo = reply.text[:MAX_ECHO] or "(no text)"  # servers reject empty messages
                request = request.after(echo, f"{error}. Answer again, by the schema.")
        reason = shorten(error, MAX_ERROR)
        raise AnswerError(f"{self.model.name}: {MAX_ATTEMPTS} invalid answers in a row; {reason}")

    def _send(self, request: Request) -> Reply:
        self.calls += 1
        return self.model.generate(request)


def _decode(cls: type[T], reply: Reply) -> tuple[T | None, str]:
    """Return the decoded answer and its error; empty if it is valid."""
    if reply.block_reason:
        return None, f"no answer ({reply.block_reason})"
    if reply.is_cut:
        return None, f"the answer was cut after {reply.tokens_out} tokens; write a shorter one"
    try:
        return decode_answer(cls, reply.text), ""
    except AnswerError as invalid:
        return None, str(invalid)


def _step(request: Request, reply: Reply, error: str) -> TraceStep:
    """Record the last message of a request and its answer; the system prompt with the first."""
    last = request.turns[-1]
    text = f"{last.text}\n\nThe answer:\n{reply.text[:MAX_ECHO]}"
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
