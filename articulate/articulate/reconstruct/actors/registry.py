"""Actors and critics by name, imported when they are asked for."""

from __future__ import annotations

import importlib
import inspect

from articulate.errors import ConfigError, MissingError, nearest
from articulate.reconstruct.actors.protocol import Actor

ACTORS = {
    "geometric-video": "articulate.reconstruct.actors.geometric.video:video_actor",
    "geometric-image": "articulate.reconstruct.actors.placement.actor:PlacingActor",
    "geometric-text": "articulate.reconstruct.actors.semantic.actor:SemanticActor",
    "prior": "articulate.reconstruct.actors.prior:PriorActor",
    "vlm": "articulate.reconstruct.actors.vlm.actor:vlm_actor",
    "hybrid": "articulate.reconstruct.actors.vlm.actor:hybrid_actor",
}
"""Where each actor is defined; called without arguments it gives an actor."""


def make_actor(name: str) -> Actor:
    """The actor called ``name``, or the one that ``module:attribute`` makes.

    Raises:
        ConfigError: There is none.
        MissingError: A package that it needs is not installed.
    """
    where = ACTORS.get(name, name)
    module, colon, attribute = where.partition(":")
    if not colon or not all(word.isidentifier() for word in module.split(".")):
        raise ConfigError(
            f"--actor {name}: neither an actor nor module:Class{nearest(name, ACTORS)}"
        )
    try:
        kind = getattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if module == missing or module.startswith(f"{missing}."):
            raise ConfigError(f"--actor {name}: there is no module {module}") from None
        raise MissingError(
            f"--actor {name} needs the package {missing}, which is not installed; install the "
            'extra that brings it, e.g. pip install "articulate-robots[all]"'
        ) from None
    except AttributeError:
        raise ConfigError(f"--actor {name}: {module} has no {attribute}") from None
    try:
        inspect.signature(kind).bind()
    except (TypeError, ValueError):
        raise ConfigError(
            f"--actor {name}: {attribute} is not called without arguments; give a class or a "
            "function that is"
        ) from None
    made: Actor = kind()
    if not callable(getattr(made, "predict", None)):
        raise ConfigError(
            f"--actor {name}: {attribute} gives no actor but {type(made).__name__}; an actor has "
            "predict(evidence)"
        )
    return made
