"""JointCritic: a model that looks at the rendering of a prediction next to what was given."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import GOOD_ENOUGH, Evidence, Prediction, Verdict
from articulate.reconstruct.actors.vlm.answers import Judged
from articulate.reconstruct.actors.vlm.gemini import Gemini
from articulate.reconstruct.actors.vlm.images import prediction_picture
from articulate.reconstruct.actors.vlm.model import Model, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import joints_told, parts_told, placed
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import Unfit, schema_of

BY = {
    "video": "how it looks beside the clip",
    "image": "how it looks beside the picture",
    "text": "how such objects move",
}
CANNOT_TELL = 3.0
"""Rating where the model gives no verdict that can be used."""


@dataclass(frozen=True, kw_only=True)
class JointCritic:
    """Judges joints by looking at them."""

    model: Model = field(default_factory=Gemini)
    cache: Path | None = field(default_factory=cache_folder)
    """Where answers are kept; None: nowhere."""
    name: str = "vlm"

    def assess(self, evidence: Evidence, prediction: Prediction) -> Verdict:
        """What the model says is wrong with the prediction, if anything is.

        A rating above :data:`GOOD_ENOUGH` is lowered to it where a failure is named.

        Raises:
            UsageError: The model cannot be asked.
        """
        if all(joint.kind == "fixed" for joint in prediction.joints):
            return Verdict(failure="joint_type", rating=0.0, reason="no joint is said to move")
        interview = ModelSession(model=self.model, cache=self.cache)
        request = critic_request(evidence, prediction)
        shown = request.turns[-1].pieces[-1]
        pictures = {} if isinstance(shown, str) else {shown.caption: shown.png}
        try:
            said = interview.ask(request, Judged)
        except Unfit as unfit:
            return Verdict(
                failure="success",
                rating=CANNOT_TELL,
                reason=f"no verdict: {unfit}",
                images=pictures,
                trace=tuple(interview.steps),
                calls=interview.calls,
            )
        rating = said.rating if said.failure == "success" else min(said.rating, GOOD_ENOUGH)
        return Verdict(
            failure=said.failure,
            rating=rating,
            reason=said.reason,
            images=pictures,
            trace=tuple(interview.steps),
            calls=interview.calls,
        )


def critic_request(evidence: Evidence, prediction: Prediction) -> Request:
    """What a model is asked about a prediction; its last piece is the rendering."""
    if not evidence.placed:
        evidence = placed(evidence, dict(prediction.placements))
    task = prompt("critic").filled(by=BY[evidence.modality], joints=joints_told(prediction.joints))
    pieces = (parts_told(evidence), prediction_picture(evidence, prediction.joints))
    return Request(
        title="what is wrong with the prediction",
        system=prompt("frame").filled(),
        turns=(Turn("user", (task, *pieces)),),
        schema=schema_of(Judged),
    )
