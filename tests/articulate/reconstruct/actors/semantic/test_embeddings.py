"""Roles of names that are in no list."""

import numpy as np
import pytest
from tests.articulate.reconstruct.actors.geometric.test_video import box

from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.semantic.actor import GUESSED_CONFIDENCE, SemanticActor
from articulate.reconstruct.actors.semantic.embeddings import (
    DESCRIPTIONS,
    MIN_COSINE,
    MiniLM,
    role_by_meaning,
)
from articulate.reconstruct.actors.semantic.ontology import ROLES


def saying(role, cosine):
    """An encoder under which every name lies at ``cosine`` to the first sentence of ``role``."""

    def encode(texts):
        vectors = np.eye(len(texts) + 1)[: len(texts)]
        vectors[0] = 0.0
        vectors[0, list(texts).index(DESCRIPTIONS[role][0])] = cosine
        vectors[0, -1] = np.sqrt(1.0 - cosine**2)
        return vectors

    return encode


def test_every_role_that_a_list_knows_has_a_sentence():
    assert set(ROLES.values()) <= set(DESCRIPTIONS)


def test_the_nearest_sentence_decides_above_the_floor():
    assert role_by_meaning("wicket", saying("door", MIN_COSINE + 0.01)) == "door"
    assert role_by_meaning("wicket", saying("door", MIN_COSINE - 0.01)) == "unknown"
    assert role_by_meaning("12", saying("door", 1.0)) == "unknown"
    assert role_by_meaning("part 3", saying("door", 1.0)) == "unknown"


def cupboard(label):
    parts = (
        box("part_00", (-0.4, -0.6, 0.0), (0.3, 0.6, 1.4), (0.7, 0.6, 0.5)),
        box("part_01", (0.3, -0.6, 0.0), (0.34, 0.6, 1.4), (0.3, 0.5, 0.8)),
    )
    labels = {"part_00": "cabinet body", "part_01": label}
    return Evidence(modality="text", parts=parts, labels=labels)


def test_a_joint_by_meaning_alone_is_said_with_little_confidence(monkeypatch):
    monkeypatch.setattr(
        "articulate.reconstruct.actors.semantic.embeddings._installed",
        lambda: saying("door", MIN_COSINE + 0.1),
    )
    listed, guessed = (
        next(j for j in SemanticActor().predict(cupboard(label)).joints if j.part == "part_01")
        for label in ("door", "wicket")
    )
    assert guessed.kind == listed.kind == "revolute"
    assert guessed.axis_o == listed.axis_o
    assert guessed.confidence == GUESSED_CONFIDENCE < listed.confidence


def test_without_the_extra_an_unlisted_name_does_not_move(monkeypatch):
    monkeypatch.setattr(
        "articulate.reconstruct.actors.semantic.embeddings._installed", lambda: None
    )
    assert role_by_meaning("wicket") == "unknown"
    (joint,) = SemanticActor().predict(cupboard("wicket")).joints
    assert joint.kind == "fixed"


def test_names_are_understood_by_the_model_of_the_extra():
    try:
        encoder = MiniLM()
    except ImportError as missing:
        pytest.skip(f"the extra 'names' is not installed ({missing.name})")
    vectors = encoder(["a sliding drawer", "a drawer that slides", "a dog"])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0)
    assert vectors[0] @ vectors[1] > 0.7 > vectors[0] @ vectors[2]
    assert role_by_meaning("pull-out compartment", encoder) == "drawer"
    assert role_by_meaning("quantum chromodynamics", encoder) == "unknown"
