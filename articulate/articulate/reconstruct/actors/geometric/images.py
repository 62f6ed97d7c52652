"""Pictures of a fit: the clip above, what the model says below."""

from __future__ import annotations

import cv2
import numpy as np

from articulate.reconstruct.actors.geometric.compositing import Layers
from articulate.reconstruct.actors.geometric.gauss_newton import model_picture
from articulate.reconstruct.actors.geometric.image_pyramid import Scene
from articulate.reconstruct.actors.geometric.search import Fit
from articulate.transforms import Array

SHOWN_PX = 160
SHOWN = 5
"""Frames in a picture."""


def compared(scene: Scene, fit: Fit) -> bytes:
    """A PNG: some frames of the clip, and under each what is expected there."""
    frames = np.unique(np.linspace(0, len(scene.video) - 1, SHOWN).round().astype(int))
    look = scene.look(SHOWN_PX, 0, frames)
    layers = look.layers(fit.parts)
    return rows_of(layers, fit.motion.T_o(fit.q[frames]))


def rows_of(layers: Layers, T_o: Array) -> bytes:
    """A PNG: the frames of ``layers`` above, the model in poses ``T_o`` (T, 4, 4) below."""
    above = np.concatenate(list(layers.shot.frames), axis=1)
    below = np.concatenate([model_picture(pose, layers) for pose in T_o], axis=1)
    both = np.concatenate([above, below]).clip(0, 255).astype(np.uint8)
    good, data = cv2.imencode(".png", cv2.cvtColor(both, cv2.COLOR_RGB2BGR))
    assert good
    return bytes(data.tobytes())
