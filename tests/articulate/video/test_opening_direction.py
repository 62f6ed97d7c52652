"""Likelihoods of openings of hinges and slides with known poses and cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from articulate.transforms import Array, normalised
from articulate.video import opening_direction
from articulate.video.joint_fit import JointFit, Kind
from articulate.video.opening_direction import (
    OPENINGS,
    SLIDES,
    TURNS,
    opening_index,
    opening_logs,
)

MIRRORED = (0, 1, 2, 4, 3, 5, 6, 8, 7)
"""Opening that a mirrored object has in place of each."""


def camera(azimuth_deg: float, elevation_deg: float) -> Array:
    """Rotation (3, 3) from the object's frame to a camera in front of it."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    ahead = -np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(ahead, right), ahead])


def fit(kind: Kind, axis: Array, side: Array, *, closes: bool = False) -> JointFit:
    """Joint in the camera frame that opens about or along ``axis``; the closed part is beside."""
    pivot = np.array([0.1, 0.05, 1.0])
    positions = np.linspace(0.0, 1.2, 9)
    return JointFit(
        kind=kind,
        axis=axis,
        pivot=pivot,
        positions=positions[::-1] if closes else positions,
        points=pivot + 0.3 * side + 0.02 * np.eye(3),
        rms=np.zeros(3),
        cost=0.0,
    )


@pytest.mark.parametrize("azimuth_deg", [-40.0, 0.0, 25.0])
@pytest.mark.parametrize("opening", range(2, 6))
@pytest.mark.parametrize("closes", [False, True])
def test_the_hinge_of_a_front_is_the_most_likely_one(
    azimuth_deg: float, opening: int, closes: bool
) -> None:
    rotation = camera(azimuth_deg, 20.0)
    axis, sides = TURNS[opening]
    hinge = fit("revolute", rotation @ axis, rotation @ sides[0], closes=closes)
    likelihoods = opening_direction._turns(hinge, 0.05 if closes else 0.95)
    assert int(np.argmax(likelihoods)) == opening


def test_a_hinge_whose_sense_is_unknown_is_still_at_its_side() -> None:
    rotation = camera(10.0, 15.0)
    axis, sides = TURNS[5]
    left, right = (
        opening_direction._turns(fit("revolute", rotation @ axis, rotation @ side), 0.5)
        for side in (sides[0], -sides[0])
    )
    assert left[5] > 3.0 * left[4]
    assert right[4] > right[5]


def test_slides_forward_and_upward_are_distinguished() -> None:
    rotation = camera(-30.0, 25.0)
    for k in (0, 1):
        slide = fit("prismatic", rotation @ SLIDES[k][0], np.zeros(3))
        assert int(np.argmax(opening_direction._slides(slide, 0.9))) == k


def test_a_mirrored_video_has_mirrored_openings() -> None:
    axis, side = normalised([0.3, -0.9, 0.4]), normalised([0.8, 0.1, 0.5])
    pivot = np.array([0.1, 0.05, 1.0])
    hinge = fit("revolute", axis, side)
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = replace(hinge, axis=-axis * flip, pivot=pivot * flip, points=hinge.points * flip)
    one, other = (opening_direction._turns(h, 0.7) for h in (hinge, mirrored))
    swapped = [MIRRORED[len(SLIDES) + k] - len(SLIDES) for k in range(len(TURNS))]
    assert other == pytest.approx([one[k] for k in swapped])
    slides = [
        opening_direction._slides(fit("prismatic", a, side), 0.7) for a in (axis, axis * flip)
    ]
    assert slides[1] == pytest.approx(slides[0])


def test_a_video_that_is_played_backwards_has_the_same_openings() -> None:
    hinge = fit("revolute", normalised([0.3, -0.9, 0.4]), normalised([0.8, 0.1, 0.5]))
    backwards = replace(hinge, positions=hinge.positions[::-1])
    forwards = opening_direction._turns(hinge, 0.8)
    assert opening_direction._turns(backwards, 0.2) == pytest.approx(forwards)


def test_densities_have_a_mean_of_one_over_all_directions() -> None:
    rng = np.random.default_rng(0)
    directions = normalised(rng.standard_normal((200_000, 3)))
    density = opening_direction._density(np.array([0.0, 0.0, 1.0]), directions, 8.0)
    assert float(density.mean()) == pytest.approx(1.0, abs=0.02)


def test_every_opening_has_its_index() -> None:
    found = [opening_index("prismatic", directions[0]) for directions in SLIDES]
    found += [opening_index("revolute", axis) for axis, _ in TURNS]
    assert found == list(range(OPENINGS))
    assert opening_index("prismatic", np.array([-1.0, 0.0, 0.0])) == 2  # into the object
    assert opening_index("continuous", np.array([0.1, 0.0, -0.9])) == OPENINGS - 1


def test_candidates_count_by_their_role(monkeypatch: pytest.MonkeyPatch) -> None:
    class Part:
        def __init__(self, opening: int) -> None:
            rotation = camera(0.0, 20.0)
            axis, sides = TURNS[opening]
            self.hinge = fit("revolute", rotation @ axis, rotation @ sides[0])
            self.slide = fit("prismatic", rotation @ SLIDES[0][0], np.zeros(3))

    class Classifier:
        def p_opening(self, kind: str, seen: object) -> float:
            return 0.9

    monkeypatch.setattr(opening_direction, "opening_features", lambda part: part)
    monkeypatch.setattr(opening_direction, "joint_classifier", Classifier)
    left, right = Part(5), Part(4)
    for role, expected in (([0.9, 0.1], 5), ([0.1, 0.9], 4)):
        logs = opening_logs([left, right], np.array(role), np.array([2.0, 2.0]))  # type: ignore[list-item]
        turns = logs[len(SLIDES) :]
        assert int(np.argmax(turns)) == expected
        assert float(np.exp(turns).sum()) == pytest.approx(1.0, abs=0.03)
