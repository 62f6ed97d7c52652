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
from articulate.reconstruct.actors.vlm.answers import MovingPart
from articulate.reconstruct.actors.vlm.hybrid import choices_request, movers_request
from articulate.reconstruct.actors.vlm.joint_actor import JointActor, program_request
from articulate.reconstruct.actors.vlm.joint_candidates import (
    joint_candidates,
    typical_joint,
    with_carriers,
)
from articulate.reconstruct.actors.vlm.joint_critic import JointCritic, critic_request
from articulate.reconstruct.actors.vlm.link_actor import LinkActor, link_request
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Model, Request


@dataclass(frozen=True, kw_only=True)
class DryRunRequest:
    """A request that would be sent."""

    request: Request
    placeholder: str = ""
    """Description of the assumed answer to an earlier request; empty if there is none."""


def write_dry_run(actor: Actor, evidence: Evidence, path: Path, description: str) -> int:
    """Write the page and return the number of requests on it.

    Args:
        actor: Actor that would send the requests.
        evidence: Evidence for the actor.
        path: HTML file, written atomically.
        description: Short description of the input.

    Raises:
        ConfigError: The actor uses no model.
    """
    model, found = dry_run_requests(actor, evidence)
    images = [image for dry in found for image in _images(dry.request)]
    page = Page(
        f"Requests to {model.name}",
        f"Input: {description}. Nothing was sent. A request is sent again, with the error, if an "
        "answer is invalid, a program breaks a rule, or the critic rates the prediction too low.",
    )
    page.tiles(
        Tile(value=len(found), label="requests"),
        Tile(value=len(images), label="images"),
        Tile(value=round(sum(len(i.png) for i in images) / 1e6, 2), label="MB of images"),
    )
    for dry in found:
        _add_request(page, dry)
    page.footer("--dry-run", {})
    page.save(path)
    return len(found)


def dry_run_requests(actor: Actor, evidence: Evidence) -> tuple[Model, list[DryRunRequest]]:
    """Return the model of an actor and the requests that it would receive.

    Raises:
        ConfigError: The actor uses no model.
    """
    if isinstance(actor, LinkActor):
        return actor.model, [DryRunRequest(request=link_request(evidence))]
    if not (isinstance(actor, Loop) and isinstance(actor.proposer, JointActor)):
        raise ConfigError(
            f"--dry-run: {actor.name} uses no model and would send nothing; "
            "give --actor vlm or --actor hybrid"
        )
    proposer = actor.proposer
    if not evidence.placed:
        return proposer.model, [DryRunRequest(request=link_request(evidence))]
    mover = _assumed_mover(evidence)
    scene = with_carriers(build_labelled_scene(evidence), [mover])
    candidates = joint_candidates([mover], scene)
    if proposer.strategy == "program":
        found = [DryRunRequest(request=program_request(evidence, ()))]
    else:
        assumed = f"{mover.part}, {mover.kind}, as the answer to the first request"
        found = [
            DryRunRequest(request=movers_request(evidence, ())),
            DryRunRequest(request=choices_request(evidence, candidates, ()), placeholder=assumed),
        ]
    if _uses_model(actor.critic, evidence):
        joint = typical_joint(candidates[0], "positive", scene)
        request = critic_request(evidence, Prediction(joints=(joint,)))
        assumed = f"a {joint.kind} joint of {joint.part}, as the prediction"
        found.append(DryRunRequest(request=request, placeholder=assumed))
    return proposer.model, found


def _uses_model(critic: Critic | None, evidence: Evidence) -> bool:
    """Return whether a critic uses a model for such evidence."""
    if isinstance(critic, HybridCritic):
        return _uses_model(critic.critic_for(evidence), evidence)
    return isinstance(critic, JointCritic)


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
