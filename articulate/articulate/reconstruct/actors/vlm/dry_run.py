"""Dry run: the prompts that would be sent, on one page, and nothing is sent.

What is asked first hangs on nothing. What is asked later hangs on answers: there a stand-in takes
the answer's place, and the page says so.
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
from articulate.reconstruct.actors.semantic.part_relations import named_scene
from articulate.reconstruct.actors.vlm.actor import HybridCritic
from articulate.reconstruct.actors.vlm.answers import Mover
from articulate.reconstruct.actors.vlm.hybrid import movers_request, picks_request
from articulate.reconstruct.actors.vlm.joint_actor import JointActor, program_request
from articulate.reconstruct.actors.vlm.joint_candidates import offers_of, usual_joint, with_carriers
from articulate.reconstruct.actors.vlm.joint_critic import JointCritic, critic_request
from articulate.reconstruct.actors.vlm.link_actor import LinkActor, link_request
from articulate.reconstruct.actors.vlm.model import Model, Picture, Request


@dataclass(frozen=True, kw_only=True)
class Dry:
    """A question that would be put to a model."""

    request: Request
    stand_in: str = ""
    """What stands for an answer that is not there; empty if the question hangs on none."""


def write_dry_run(actor: Actor, evidence: Evidence, path: Path, told: str) -> int:
    """Write the page; return how many questions are on it.

    Args:
        actor: Who would ask.
        evidence: What it would be given.
        path: HTML file, written whole or not at all.
        told: What was given, in a few words.

    Raises:
        ConfigError: The actor asks no model.
    """
    model, found = questions(actor, evidence)
    pictures = [p for dry in found for p in _pictures(dry.request)]
    page = Page(
        f"What {model.name} would be asked",
        f"About {told}. Nothing was sent. A question is put again, with what was wrong, where an "
        "answer does not fit, a program breaks a rule, or a critic is not content.",
    )
    page.tiles(
        Tile(value=len(found), label="questions"),
        Tile(value=len(pictures), label="pictures"),
        Tile(value=round(sum(len(p.png) for p in pictures) / 1e6, 2), label="MB of pictures"),
    )
    for dry in found:
        _shown(page, dry)
    page.footer("--dry-run", {})
    page.save(path)
    return len(found)


def questions(actor: Actor, evidence: Evidence) -> tuple[Model, list[Dry]]:
    """Who would be asked, and what.

    Raises:
        ConfigError: The actor asks no model.
    """
    if isinstance(actor, LinkActor):
        return actor.model, [Dry(request=link_request(evidence))]
    if not (isinstance(actor, Loop) and isinstance(actor.proposer, JointActor)):
        raise ConfigError(
            f"--dry-run: {actor.name} asks no model, so that nothing would be sent; "
            "give --actor vlm or --actor hybrid"
        )
    proposer = actor.proposer
    if not evidence.placed:
        return proposer.model, [Dry(request=link_request(evidence))]
    mover = _stand_in(evidence)
    scene = with_carriers(named_scene(evidence), [mover])
    offers = offers_of([mover], scene)
    if proposer.way == "program":
        found = [Dry(request=program_request(evidence, ()))]
    else:
        told = f"{mover.part}, {mover.kind}, as if it were the answer to the first question"
        found = [
            Dry(request=movers_request(evidence, ())),
            Dry(request=picks_request(evidence, offers, ()), stand_in=told),
        ]
    if _asks(actor.critic, evidence):
        joint = usual_joint(offers[0], "positive", scene)
        request = critic_request(evidence, Prediction(joints=(joint,)))
        told = f"a {joint.kind} joint of {joint.part}, as if it were the answer"
        found.append(Dry(request=request, stand_in=told))
    return proposer.model, found


def _asks(critic: Critic | None, evidence: Evidence) -> bool:
    """Whether a critic asks a model about such evidence."""
    if isinstance(critic, HybridCritic):
        return _asks(critic.chosen(evidence), evidence)
    return isinstance(critic, JointCritic)


def _stand_in(evidence: Evidence) -> Mover:
    """The second largest part, as if it were seen to turn."""
    by_size = sorted(evidence.parts, key=lambda p: -float(np.prod(np.ptp(p.bounds, axis=0))))
    return Mover(part=by_size[min(1, len(by_size) - 1)].name, kind="revolute", why="stand-in")


def _shown(page: Page, dry: Dry) -> None:
    request = dry.request
    page.section(f"Question: {request.title}")
    if dry.stand_in:
        page.text(f"With a stand-in: {dry.stand_in}. The real question will differ in it.")
    page.text("What holds for the whole conversation:")
    page.code(request.system)
    page.text("The question:")
    for turn in request.turns:
        for piece in turn.pieces:
            if isinstance(piece, Picture):
                page.png(piece.png, piece.caption)
            else:
                page.code(piece)
    page.text("The JSON schema of the answer:")
    page.code(json.dumps(request.schema, indent=1))


def _pictures(request: Request) -> Sequence[Picture]:
    return [p for turn in request.turns for p in turn.pieces if isinstance(p, Picture)]
