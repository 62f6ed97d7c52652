"""Dry run: write the requests that an actor would send to one page, without sending them.

Later requests depend on earlier answers. The page fills in a placeholder for such an answer and
marks it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from articulate.errors import ConfigError
from articulate.page import Page, Tile
from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.protocol import Actor, Critic, Evidence, Prediction
from articulate.reconstruct.actors.semantic.part_relations import build_labelled_scene
from articulate.reconstruct.actors.vlm.actor import HybridCritic
from articulate.reconstruct.actors.vlm.affordance import affordance_request
from articulate.reconstruct.actors.vlm.answers import MovingPart, ProgramAnswer
from articulate.reconstruct.actors.vlm.hybrid import choices_request, movers_request
from articulate.reconstruct.actors.vlm.joint_actor import JointActor, program_request
from articulate.reconstruct.actors.vlm.joint_candidates import (
    joint_candidates,
    typical_joint,
    with_carriers,
)
from articulate.reconstruct.actors.vlm.joint_critic import JointCritic, critic_request
from articulate.reconstruct.actors.vlm.link_actor import LinkActor, link_request
from articulate.reconstruct.actors.vlm.link_critic import link_critic_request
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Model, Request
from articulate.reconstruct.actors.vlm.model_session import MAX_ATTEMPTS
from articulate.reconstruct.actors.vlm.programs import MAX_PROGRAMS
from articulate.reconstruct.actors.vlm.schema import schema_of

ANSWER_TOKENS = 500
"""Assumed tokens of an answer, thoughts included."""


@dataclass(frozen=True, kw_only=True)
class DryRunRequest:
    """A request that would be sent."""

    request: Request
    placeholder: str = ""
    """Description of the assumed answer to an earlier request; empty if there is none."""


@dataclass(frozen=True, kw_only=True)
class DryRunSize:
    """Size of the requests: without repetition, and with all that the limits permit."""

    requests: int = 0
    requests_max: int = 0
    tokens_in: int = 0
    """Estimated input tokens."""
    tokens_in_max: int = 0
    tokens_out: int = 0
    """Output tokens, :data:`ANSWER_TOKENS` for each request."""
    tokens_out_max: int = 0

    def plus(self, other: DryRunSize) -> DryRunSize:
        """Return the sum."""
        return DryRunSize(**{key: n + getattr(other, key) for key, n in vars(self).items()})

    def times(self, n: int) -> DryRunSize:
        """Return the size of ``n`` such runs."""
        return DryRunSize(**{key: n * value for key, value in vars(self).items()})


def write_dry_run(actor: Actor, evidence: Evidence, path: Path, description: str) -> DryRunSize:
    """Write the page and return the size of the requests.

    Args:
        actor: Actor that would send the requests.
        evidence: Evidence for the actor.
        path: HTML file, written atomically.
        description: Short description of the input.

    Raises:
        ConfigError: The actor uses no model.
    """
    model, found = dry_run_requests(actor, evidence)
    size = _size(actor, model, found)
    images = [image for dry in found for image in _images(dry.request)]
    page = Page(
        f"Requests to {model.name}",
        f"Input: {description}. Nothing was sent. A request is sent again, with the error, if an "
        "answer is invalid, a program breaks a rule, or the critic rates the prediction too low.",
    )
    page.tiles(
        Tile(value=len(found), label="requests"),
        Tile(value=size.tokens_in, label="input tokens, estimated"),
        Tile(value=len(images), label="images"),
        Tile(value=round(sum(len(i.png) for i in images) / 1e6, 2), label="MB of images"),
    )
    for dry in found:
        _add_request(page, dry)
    page.footer("--dry-run", {})
    page.save(path)
    return size


def _size(actor: Actor, model: Model, found: Sequence[DryRunRequest]) -> DryRunSize:
    """Estimate tokens; the upper bound repeats every proposal, program and invalid answer."""
    iterations = actor.max_iterations if isinstance(actor, Loop) else 1
    requests_max = tokens = tokens_max = 0
    for dry in found:
        is_program = dry.request.schema == schema_of(ProgramAnswer)
        n = iterations * MAX_ATTEMPTS * (MAX_PROGRAMS if is_program else 1)
        one = model.estimate_tokens(dry.request)
        requests_max += n
        tokens += one
        tokens_max += n * (one + MAX_ATTEMPTS * MAX_PROGRAMS * ANSWER_TOKENS)
    return DryRunSize(
        requests=len(found),
        requests_max=requests_max,
        tokens_in=tokens,
        tokens_in_max=tokens_max,
        tokens_out=ANSWER_TOKENS * len(found),
        tokens_out_max=ANSWER_TOKENS * requests_max,
    )


def dry_run_requests(actor: Actor, evidence: Evidence) -> tuple[Model, list[DryRunRequest]]:
    """Return the model of an actor and the requests that it would receive.

    Raises:
        ConfigError: The actor uses no model.
    """
    if isinstance(actor, LinkActor):
        return actor.model, _placement_requests(evidence, actor.examples, actor.assessed)
    if not (isinstance(actor, Loop) and isinstance(actor.proposer, JointActor)):
        raise ConfigError(
            f"--dry-run: {actor.name} uses no model and would send nothing; "
            "give --actor vlm or --actor hybrid"
        )
    proposer = actor.proposer
    if not evidence.placed:
        found = _placement_requests(evidence, proposer.examples, proposer.assess_placements)
        return proposer.model, found
    mover = _assumed_mover(evidence)
    scene = with_carriers(build_labelled_scene(evidence), [mover])
    candidates = joint_candidates([mover], scene)
    assumed = f"{mover.part}, {mover.kind}, as the answer to the first request"
    if proposer.strategy == "program":
        targeted = proposer.targeted and evidence.video is not None
        found = (
            [DryRunRequest(request=affordance_request(evidence, proposer.examples))]
            if targeted
            else []
        )
        request = program_request(
            evidence, (), examples=proposer.examples, target=mover.part if targeted else ""
        )
        found.append(DryRunRequest(request=request, placeholder=assumed if targeted else ""))
    else:
        found = [
            DryRunRequest(request=movers_request(evidence, ())),
            DryRunRequest(request=choices_request(evidence, candidates, ()), placeholder=assumed),
        ]
    critic = _model_critic(actor.critic, evidence)
    if critic is not None:
        joint = typical_joint(candidates[0], "positive", scene)
        request = critic_request(evidence, Prediction(joints=(joint,)), critic.examples)
        assumed = f"a {joint.kind} joint of {joint.part}, as the prediction"
        found.append(DryRunRequest(request=request, placeholder=assumed))
    return proposer.model, found


def _placement_requests(evidence: Evidence, examples: int, assessed: bool) -> list[DryRunRequest]:
    """Return the requests for placements of parts; those for joints depend on the placements."""
    found = [DryRunRequest(request=link_request(evidence, examples))]
    if assessed and evidence.image is not None:
        assumed = "that all parts are at the origin, as the placement"
        same = {part.name: np.eye(4) for part in evidence.parts}
        request = link_critic_request(evidence, same, examples)
        found.append(DryRunRequest(request=request, placeholder=assumed))
    return found


def _model_critic(critic: Critic | None, evidence: Evidence) -> JointCritic | None:
    """Return the critic that uses a model for such evidence; None if there is none."""
    if isinstance(critic, HybridCritic):
        return _model_critic(critic.critic_for(evidence), evidence)
    return critic if isinstance(critic, JointCritic) else None


def _assumed_mover(evidence: Evidence) -> MovingPart:
    """Return the second largest part as a part that turns."""
    by_size = sorted(evidence.parts, key=lambda p: -float(np.prod(np.ptp(p.bounds, axis=0))))
    return MovingPart(
        part=by_size[min(1, len(by_size) - 1)].name, kind="revolute", why="placeholder"
    )


def _add_request(page: Page, dry: DryRunRequest) -> None:
    request = dry.request
    page.section(f"Request: {request.title}")
    if dry.placeholder:
        page.text(f"It assumes {dry.placeholder}. The real request will differ here.")
    page.text("System prompt:")
    page.code(request.system)
    page.text("Messages:")
    for turn in request.turns:
        for item in turn.content:
            if isinstance(item, str):
                page.code(item)
                continue
            for image in [item] if isinstance(item, CaptionedImage) else item.frames:
                page.png(image.png, image.caption)
    page.text("JSON schema of the answer:")
    page.code(json.dumps(request.schema, indent=1))


def _images(request: Request) -> Sequence[CaptionedImage]:
    return [c for turn in request.turns for c in turn.content if isinstance(c, CaptionedImage)]
