"""Models by name: ``[PROVIDER:]NAME[@URL]``."""

from __future__ import annotations

import os
from collections.abc import Mapping

from articulate.errors import ConfigError, nearest, quote
from articulate.reconstruct.actors.vlm.anthropic import AnthropicFormat
from articulate.reconstruct.actors.vlm.budget import Budget
from articulate.reconstruct.actors.vlm.gemini import DEFAULT_MODEL, GeminiFormat
from articulate.reconstruct.actors.vlm.http_model import MODEL_VARIABLE, HttpModel, check_url
from articulate.reconstruct.actors.vlm.openai_compatible import OpenAIFormat
from articulate.reconstruct.actors.vlm.wire_format import WireFormat

FORMATS: Mapping[str, WireFormat] = {
    "gemini": GeminiFormat(),
    "openai": OpenAIFormat(),
    "anthropic": AnthropicFormat(),
}
"""Wire formats by provider."""
MAX_NAME = 200


def default_model() -> HttpModel:
    """Return the model that the environment names, or the default."""
    return create_model("")


def create_model(name: str, budget: Budget | None = None) -> HttpModel:
    """Return a model.

    Args:
        name: ``[PROVIDER:]NAME[@URL]``; without provider a Gemini model; empty: the model that the
            environment names, or the default.
        budget: Budget of all requests; None: no limits.

    Raises:
        ConfigError: The provider or the URL is invalid.
    """
    origin = "--model" if name else MODEL_VARIABLE
    spec = name or os.environ.get(MODEL_VARIABLE, "").strip() or DEFAULT_MODEL
    spec, at, url = spec.partition("@")
    provider, colon, model = spec.partition(":")
    if not colon:
        provider, model = "gemini", spec
    if provider not in FORMATS:
        raise ConfigError(
            f"{origin} {quote(spec)}: unknown provider {quote(provider)}"
            f"{nearest(provider, FORMATS)}; write PROVIDER:NAME or PROVIDER:NAME@URL"
        )
    if (
        not model
        or len(model) > MAX_NAME
        or not model.isprintable()
        or {"?", "#", " "} & set(model)
    ):
        raise ConfigError(f"{origin} {quote(spec)}: must be PROVIDER:NAME or PROVIDER:NAME@URL")
    return HttpModel(
        wire_format=FORMATS[provider],
        model=model,
        base_url=check_url(url) if at else "",
        budget=budget or Budget(),
    )
