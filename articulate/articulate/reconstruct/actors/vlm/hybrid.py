"""Hybrid: a model says what is semantic, geometry computes every number.

The model is asked which parts move and of what kind their joints are, then which of the candidates
it is that geometry offers for these parts, and which way they open. From a clip geometry then finds
axis, pivot and limits near the chosen candidate; without one the candidate itself is the joint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from articulate.reconstruct.actors.geometric.candidates import Motion
from articulate.reconstruct.actors.geometric.fit import Wish, find_motion
from articulate.reconstruct.actors.geometric.video import joints_of, scene_from
from articulate.reconstruct.actors.protocol import (
    ActorAttempt,
    Evidence,
    PredictedJoint,
    Prediction,
)
from articulate.reconstruct.actors.semantic.part_relations import Named, named_scene
from articulate.reconstruct.actors.vlm.answers import Mover, Movers, Picks
from articulate.reconstruct.actors.vlm.joint_candidates import (
    Offer,
    offers_of,
    offers_picture,
    offers_told,
    usual_joint,
    with_carriers,
)
from articulate.reconstruct.actors.vlm.model import Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import attempts_told, pieces_of
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import schema_of

WHICH = {
    "video": "Name the part that moves in the clip; several only if they move on their own.",
    "image": "Name all parts that can move, whether they are open or closed.",
    "text": "Name all parts that can move.",
}
NEAR_SHARE = 0.15
"""In a clip the axis is sought as far from the chosen one as this share of the part's size."""
MOST_PICTURES = 4
"""Parts whose candidates are drawn."""


def chosen_joints(
    interview: ModelSession, evidence: Evidence, attempts: Sequence[ActorAttempt]
) -> Prediction:
    """The joints that a model chooses.

    Raises:
        Unfit: The model gives no answer that can be used.
        UsageError: The model cannot be asked.
    """
    movers = interview.ask(movers_request(evidence, attempts), Movers, _only_parts(evidence)).movers
    if not movers:
        return Prediction(joints=(), rejection=f"{interview.model.name} sees no part that moves")
    scene = with_carriers(named_scene(evidence), movers)
    offers = offers_of(movers, scene)
    request = picks_request(evidence, offers, attempts)
    picks = interview.ask(request, Picks, _only_offers(movers, offers)).picks
    chosen = [(offers[pick.candidate - 1], pick.opens) for pick in picks]
    if evidence.video is not None and evidence.camera is not None:
        return _measured([offer for offer, _ in chosen], evidence, scene)
    joints = [usual_joint(offer, opens, scene) for offer, opens in chosen]
    return Prediction(joints=(*joints, *_riders(joints, scene)))


def movers_request(evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Request:
    """Which part moves: what was given, beside the parts in colours of their own."""
    return Request(
        title="which parts move",
        system=prompt("frame").filled(),
        turns=(
            Turn(
                "user",
                (
                    prompt("movers").filled(which=WHICH[evidence.modality]),
                    *pieces_of(evidence),
                    *attempts_told(attempts),
                ),
            ),
        ),
        schema=schema_of(Movers),
    )


def picks_request(
    evidence: Evidence, offers: Sequence[Offer], attempts: Sequence[ActorAttempt]
) -> Request:
    """Which of the candidates it is."""
    groups = [list(group) for _, group in groupby(offers, key=lambda offer: offer.part)]
    drawn = [offers_picture(evidence, group) for group in groups[:MOST_PICTURES]]
    return Request(
        title="which of the joints that the shapes allow",
        system=prompt("frame").filled(),
        turns=(
            Turn(
                "user",
                (
                    prompt("picks").filled(candidates=offers_told(offers)),
                    *pieces_of(evidence),
                    *drawn,
                    *attempts_told(attempts),
                ),
            ),
        ),
        schema=schema_of(Picks),
    )


def _only_parts(evidence: Evidence) -> Callable[[Movers], str]:
    names = [part.name for part in evidence.parts]

    def check(answer: Movers) -> str:
        said = [mover.part for mover in answer.movers]
        for name in said:
            if name not in names:
                return f"there is no part {name!r}; the parts are {', '.join(names)}"
            if said.count(name) > 1:
                return f"{name} is named twice; name each part once"
        return "at least one part stands still" if len(said) == len(names) else ""

    return check


def _only_offers(movers: Sequence[Mover], offers: Sequence[Offer]) -> Callable[[Picks], str]:
    wanted = sorted(mover.part for mover in movers)

    def check(answer: Picks) -> str:
        if sorted(pick.part for pick in answer.picks) != wanted:
            return f"choose one candidate for each of {', '.join(wanted)}"
        for pick in answer.picks:
            known = [offer.number for offer in offers if offer.part == pick.part]
            if pick.candidate not in known:
                told = f"{known[0]} to {known[-1]}"
                return f"candidate {pick.candidate} is none of {pick.part}; these are {told}"
        return ""

    return check


def _measured(chosen: Sequence[Offer], evidence: Evidence, scene: Named) -> Prediction:
    """The joints near the chosen ones that explain the clip best."""
    clip = scene_from(evidence)
    names = [part.name for part in clip.parts]
    joints: list[PredictedJoint] = []
    for offer in chosen:
        near = Motion(
            "slide" if offer.kind == "prismatic" else "turn",
            offer.axis_o,
            offer.pivot_o,
            f"candidate {offer.number}",
        )
        size = float(np.linalg.norm(scene.shapes[offer.part].size))
        wish = Wish(
            kind=near.kind, part=names.index(offer.part), near=near, near_m=NEAR_SHARE * size
        )
        fit = find_motion(clip, wish) if clip.change.any() else None
        if fit is None:
            return Prediction(
                joints=(),
                rejection=f"no {offer.kind} joint of {offer.part} explains what changes in the clip",
            )
        lead, *fixed = joints_of(fit, clip, 1.0)
        taken = {joint.part for joint in joints}
        joints += [_of_kind(lead, offer, fit.q), *(j for j in fixed if j.part not in taken)]
    return Prediction(joints=tuple({joint.part: joint for joint in joints}.values()))


def _of_kind(joint: PredictedJoint, offer: Offer, q: np.ndarray) -> PredictedJoint:
    """The joint, of the kind that the model says."""
    if offer.kind == "continuous":
        return replace(joint, kind="continuous", lower=None, upper=None)
    if joint.kind == "continuous":
        return replace(joint, kind="revolute", lower=float(q.min()), upper=float(q.max()))
    return joint


def _riders(joints: Sequence[PredictedJoint], scene: Named) -> list[PredictedJoint]:
    """Fixed joints of what hangs on parts that move."""
    moving = {joint.part for joint in joints}
    return [
        PredictedJoint(part=name, parent=on, kind="fixed")
        for name, on in scene.hangs.items()
        if name not in moving and on in moving
    ]
