"""Ablations: the actor of clips without one of its parts, to tell what each buys.

articulate benchmark assets.json --actor articulate.reconstruct.actors.geometric.ablations:without_tracks
"""

from __future__ import annotations

from articulate.reconstruct.actors.geometric.video import video_actor
from articulate.reconstruct.actors.loop import Loop


def without_critic() -> Loop:
    """The first proposal is the answer."""
    return video_actor(critic=False)


def without_tracks() -> Loop:
    """The critic asks edges alone."""
    return video_actor(tracks=False)


def without_calibration() -> Loop:
    """The camera is taken to be where it is said to be."""
    return video_actor(calibrate=False)
