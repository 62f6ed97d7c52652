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


@pytest.mark.parametrize(
    ("known", "weakest"),
    [
        (MotionEvidence(category=0.3, joint=0.95, error=0.6), "category"),
        (MotionEvidence(category=0.9, joint=0.05, error=0.6), "joint"),
        (MotionEvidence(category=0.95, joint=0.9, error=1.0), "motion"),
    ],
)
def test_doubtful_video_names_its_weakest_evidence(known: MotionEvidence, weakest: str) -> None:
    sure = MotionEvidence(category=0.97, joint=0.97, error=0.6)
    assert sure.confidence() > MIN_MOTION > known.confidence()
    assert known.weakest() == weakest
