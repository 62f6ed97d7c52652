"""An actor that is wrong: everything sinks."""

from dataclasses import dataclass

from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction


@dataclass(frozen=True)
class Downwards:
    """Says that the part ``drawer`` slides down, whatever is below."""

    name: str = "downwards"

    def predict(self, evidence: Evidence) -> Prediction:
        joint = PredictedJoint(
            part="drawer",
            parent="body",
            kind="prismatic",
            axis_o=(0.0, 0.0, -1.0),
            lower=0.0,
            upper=0.25,
        )
        return Prediction(joints=(joint,))
