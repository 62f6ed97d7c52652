"""Actors by name, imported on demand."""

from __future__ import annotations

import importlib
import inspect

from articulate.errors import ConfigError, MissingError, nearest
from articulate.reconstruct.actors.protocol import Actor

ACTORS = {
    "geometric-video": "articulate.reconstruct.actors.geometric.video:video_actor",
    "geometric-image": "articulate.reconstruct.actors.placement.actor:PlacementActor",
    "geometric-text": "articulate.reconstruct.actors.semantic.actor:SemanticActor",
    "prior": "articulate.reconstruct.actors.prior:PriorActor",
    "vlm": "articulate.reconstruct.actors.vlm.actor:vlm_actor",
    "hybrid": "articulate.reconstruct.actors.vlm.actor:hybrid_actor",
}
"""Callables without arguments that return an actor, by name."""


def make_actor(name: str) -> Actor:
    """Return the actor called ``name``, or the one that ``module:attribute`` creates.

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
            f"--actor {name}: {attribute} has required or unknown arguments; give a class or a "
            "function that needs none"
        ) from None
    made: Actor = kind()
    if not callable(getattr(made, "predict", None)):
        raise ConfigError(
            f"--actor {name}: {attribute} returns {type(made).__name__}, no actor; an actor has "
            "predict(evidence)"
        )
    return made
