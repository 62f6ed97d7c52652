"""Settings of the models of an actor: which model, its budget, examples and stored answers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from articulate.cache import cache_folder
from articulate.errors import ConfigError
from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.protocol import Actor
from articulate.reconstruct.actors.vlm.actor import HybridCritic
from articulate.reconstruct.actors.vlm.answer_store import open_recording
from articulate.reconstruct.actors.vlm.budget import Budget, BudgetLimits, Usage
from articulate.reconstruct.actors.vlm.joint_actor import JointActor
from articulate.reconstruct.actors.vlm.joint_critic import JointCritic
from articulate.reconstruct.actors.vlm.link_actor import LinkActor
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.providers import create_model

LEDGER = "model_usage.json"
"""File with the use of a model by all processes of a run."""
MAX_EXAMPLES = 20


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """Settings of models; the defaults change nothing. All values are JSON."""

    model: str = ""
    """``[PROVIDER:]NAME[@URL]``; empty: that of the environment or the default."""
    budget: tuple[str, ...] = ()
    """Limits as ``KEY=NUMBER``."""
    examples: int | None = None
    """Number of in-context examples; None: the actor's default."""
    record: str = ""
    """Folder that stores all answers; empty: the cache."""
    ledger: str = ""
    """File in which processes count their use together; empty: each on its own."""

    def __post_init__(self) -> None:
        """Check the values."""
        object.__setattr__(self, "budget", tuple(self.budget))
        BudgetLimits.from_words(self.budget)
        if self.model:
            create_model(self.model)
        if self.examples is not None and not 0 <= self.examples <= MAX_EXAMPLES:
            raise ConfigError(f"--examples is {self.examples}; it must be in [0, {MAX_EXAMPLES}]")

    @property
    def source(self) -> str:
        """Model and server."""
        return create_model(self.model).source

    @property
    def usage(self) -> Usage:
        """Use that the ledger holds."""
        return Budget(ledger=Path(self.ledger)).used if self.ledger else Usage()

    def recorded(self, folder: Path) -> ModelOptions:
        """Return the options with all answers stored in a recording, and its model.

        Raises:
            ConfigError: The folder holds something else, or answers of another model.
        """
        spec = open_recording(folder, self.model, create_model(self.model).spec)
        return replace(self, model=spec, record=str(folder), ledger=str(folder / LEDGER))

    def session(self) -> ModelSession:
        """Open a session with the model, its budget and stored answers."""
        limits = BudgetLimits.from_words(self.budget)
        budget = Budget(limits=limits, ledger=Path(self.ledger) if self.ledger else None)
        cache = Path(self.record) if self.record else cache_folder()
        return ModelSession(model=create_model(self.model, budget), cache=cache)

    def apply(self, actor: Actor) -> Actor:
        """Return an actor that uses these settings.

        Raises:
            ConfigError: The actor uses no model.
        """
        if self == ModelOptions():
            return actor
        session = self.session()
        shared: dict[str, Any] = {"model": session.model, "cache": session.cache}
        changed = _with(actor, shared, self.examples)
        if changed is actor:
            raise ConfigError(
                f"--actor {actor.name} uses no model; omit --model, --budget, --examples "
                "and --record, or give --actor vlm or --actor hybrid"
            )
        return changed  # type: ignore[no-any-return]  # of the same class


def _with(part: Any, shared: dict[str, Any], examples: int | None) -> Any:
    """Return an actor or critic with the settings, or itself if it uses no model."""
    if isinstance(part, JointActor | JointCritic | LinkActor):
        more: dict[str, Any] = {} if examples is None else {"examples": examples}
        return replace(part, **shared, **more)
    if isinstance(part, HybridCritic):
        return replace(part, visual=_with(part.visual, shared, examples))
    if isinstance(part, Loop):
        proposer = _with(part.proposer, shared, examples)
        critic = _with(part.critic, shared, examples)
        if proposer is not part.proposer or critic is not part.critic:
            return replace(part, proposer=proposer, critic=critic)
    return part
