"""Confidence of proposed objects."""

from __future__ import annotations

import pytest

from articulate.reconstruct.fitting.confidence import (
    MIN_CONFIDENCE,
    MIN_MOTION,
    Evidence,
    MotionEvidence,
)


def test_confidence_grows_with_the_evidence() -> None:
    best = Evidence(category=0.98, parts=0.95)
    assert best.confidence() > MIN_CONFIDENCE
    for worse in (
        Evidence(category=0.3, parts=0.95),
        Evidence(category=0.98, parts=0.1),
    ):
        assert worse.confidence() < best.confidence()


@pytest.mark.parametrize(
    ("known", "weakest"),
    [
        (Evidence(category=0.05, parts=0.95), "category"),
        (Evidence(category=0.98, parts=0.0), "parts"),
    ],
)
def test_the_weakest_evidence_is_named(known: Evidence, weakest: str) -> None:
    assert known.weakest() == weakest


def test_a_video_is_certain_only_if_its_category_is() -> None:
    sure, unsure = (MotionEvidence(category=p, joint=0.9).confidence() for p in (0.8, 0.5))
    assert sure > MIN_MOTION > unsure
