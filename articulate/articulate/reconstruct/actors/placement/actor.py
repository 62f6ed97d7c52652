"""Actor for images: place parts where an image shows them, then predict joints by name.

Joints of parts in their places are compared with the image.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from articulate.errors import UsageError
from articulate.reconstruct.actors.geometric.image import correct_joints
from articulate.reconstruct.actors.geometric.kernels import LIGHT_ROWS
from articulate.reconstruct.actors.placement.placement_problem import background_of, build_problem
from articulate.reconstruct.actors.placement.search import solve, unexplained_share
from articulate.reconstruct.actors.protocol import Actor, Evidence, Prediction, TraceStep
from articulate.reconstruct.actors.semantic.actor import SemanticActor
from articulate.render.camera import Camera
from articulate.render.scene import Light
from articulate.transforms import Array, apply, normalised, pose


@dataclass(frozen=True)
class PlacementActor:
    """Actor that places parts by an image; another actor predicts their joints."""

    joints: Actor = field(default_factory=SemanticActor)
    name: str = "geometric-image"

    def predict(self, evidence: Evidence) -> Prediction:
        """Return the placement of the parts, if they are not placed, and their joints."""
        if evidence.placed:
            predicted = self.joints.predict(evidence)
            if evidence.image is None or evidence.camera is None:
                return predicted
            light = default_light(evidence.camera)
            return correct_joints(evidence, predicted, background_of(evidence.image), light)
        start = time.monotonic()
        placements, unexplained = place_parts(evidence)
        moved = tuple(part.moved(placements[part.name]) for part in evidence.parts)
        step = TraceStep(
            title="placement of the parts by rendering and comparing",
            text="; ".join(
                f"{name}: {np.round(T[:3, 3], 3).tolist()}" for name, T in placements.items()
            ),
            figures={"share of the object left unexplained": unexplained},
            seconds=time.monotonic() - start,
        )
        try:
            predicted = self.joints.predict(replace(evidence, parts=moved, placed=True))
        except UsageError as error:  # the placements are known nevertheless
            predicted = Prediction(joints=(), rejection=str(error))
        return replace(predicted, placements=placements, trace=(step, *predicted.trace))


def placements_of(evidence: Evidence) -> dict[str, Array]:
    """Return the placement ``T_op`` (4, 4) of each part by name.

    Raises:
        UsageError: There is no image, or its camera is unknown.
    """
    return place_parts(evidence)[0]


def place_parts(evidence: Evidence) -> tuple[dict[str, Array], float]:
    """Return the placements by name and the unexplained share of the object's pixels."""
    if evidence.image is None or evidence.camera is None:
        raise UsageError("placing parts needs an image and its camera; give --modality image")
    camera = evidence.camera
    centres = [part.centre for part in evidence.parts]
    parts = [p.moved(pose(-c)) for p, c in zip(evidence.parts, centres, strict=True)]
    problem = build_problem(parts, evidence.image, camera, default_light(camera))
    found = solve(problem)
    placements = {
        part.name: pose(apply(camera.T_wc, found[i]) - centres[i])
        for i, part in enumerate(evidence.parts)
    }
    return placements, unexplained_share(problem, found)


def default_light(camera: Camera) -> Array:
    """Return the light of rendered images (LIGHT_ROWS, 3) in the camera frame."""
    default = Light()
    light = np.empty((LIGHT_ROWS, 3))
    light[0], light[1], light[2] = default.ambient, default.head, default.directional
    light[3] = camera.T_cw[:3, :3] @ -normalised(default.direction_w)
    return light
