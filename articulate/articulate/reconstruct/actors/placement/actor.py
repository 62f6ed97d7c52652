"""PlacingActor: puts parts where a picture shows them, then says their joints by name."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from articulate.errors import UsageError
from articulate.reconstruct.actors.geometric.kernels import LIGHT_ROWS
from articulate.reconstruct.actors.placement.placement_problem import puzzle_of
from articulate.reconstruct.actors.placement.search import solve, unexplained_share
from articulate.reconstruct.actors.protocol import Actor, Evidence, Prediction, TraceStep
from articulate.reconstruct.actors.semantic.actor import SemanticActor
from articulate.render.camera import Camera
from articulate.render.scene import Light
from articulate.transforms import Array, apply, normalised, pose


@dataclass(frozen=True)
class PlacementActor:
    """Places parts by a picture; joints are those of another actor that is given placed parts."""

    joints: Actor = field(default_factory=SemanticActor)
    name: str = "geometric-image"

    def predict(self, evidence: Evidence) -> Prediction:
        """Where parts belong, if that is asked, and their joints."""
        if evidence.placed:
            return self.joints.predict(evidence)
        start = time.monotonic()
        places, unexplained = placed_by(evidence)
        moved = tuple(part.moved(places[part.name]) for part in evidence.parts)
        step = TraceStep(
            title="where parts belong, by drawing them and comparing",
            text="; ".join(
                f"{name}: {np.round(T[:3, 3], 3).tolist()}" for name, T in places.items()
            ),
            figures={"share of the object left unexplained": unexplained},
            seconds=time.monotonic() - start,
        )
        try:
            said = self.joints.predict(replace(evidence, parts=moved, placed=True))
        except UsageError as error:  # where parts are is known even so
            said = Prediction(joints=(), rejection=str(error))
        return replace(said, placements=places, trace=(step, *said.trace))


def places_of(evidence: Evidence) -> dict[str, Array]:
    """Where each part belongs, ``T_op`` (4, 4) by name.

    Raises:
        UsageError: There is no picture, or its camera is not known.
    """
    return placed_by(evidence)[0]


def placed_by(evidence: Evidence) -> tuple[dict[str, Array], float]:
    """Where each part belongs, and the share of the object's pixels that is not explained then."""
    if evidence.image is None or evidence.camera is None:
        raise UsageError("placing parts needs a picture and its camera; give --modality image")
    camera = evidence.camera
    centres = [part.centre for part in evidence.parts]
    parts = [p.moved(pose(-c)) for p, c in zip(evidence.parts, centres, strict=True)]
    puzzle = puzzle_of(parts, evidence.image, camera, usual_light(camera))
    found = solve(puzzle)
    places = {
        part.name: pose(apply(camera.T_wc, found[i]) - centres[i])
        for i, part in enumerate(evidence.parts)
    }
    return places, unexplained_share(puzzle, found)


def usual_light(camera: Camera) -> Array:
    """The light of rendered pictures (LIGHT_ROWS, 3), in the camera's frame."""
    usual = Light()
    light = np.empty((LIGHT_ROWS, 3))
    light[0], light[1], light[2] = usual.ambient, usual.head, usual.directional
    light[3] = camera.T_cw[:3, :3] @ -normalised(usual.direction_w)
    return light
