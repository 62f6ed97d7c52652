"""Parts for a described object from the meshes of a library.

::

    text ─► task specifier ─► layout planner ─► captions of a library's parts (part annotator)
         ─► most similar mesh of each planned part, scaled to its size ─► separate parts
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from articulate.errors import AssetError, UsageError
from articulate.formats.load_meshes import Piece
from articulate.reconstruct.actors.protocol import Evidence, TraceStep
from articulate.reconstruct.actors.semantic.embeddings import text_similarity
from articulate.reconstruct.actors.vlm.answers import (
    DenseDescription,
    DetectedObject,
    Layout,
    PartCaptions,
    PlannedPart,
)
from articulate.reconstruct.actors.vlm.images import front_image, parts_image
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import describe_parts
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.retrieval import LibraryObject, candidates_for
from articulate.reconstruct.actors.vlm.schema import schema_of
from articulate.reconstruct.part_set import PartSet, separate_part_set

MAX_ANNOTATED = 6
"""Most objects of the library whose parts are captioned."""
MIN_SIDE_M = 1e-6


@dataclass(frozen=True, eq=False)
class CaptionedPart:
    """A mesh of the library with its caption."""

    caption: str
    pieces: tuple[Piece, ...]
    source: str
    licence: str


def specify_task(session: ModelSession, text: str) -> str:
    """Extend a short request to a description of all parts.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    request = Request(
        title="dense description",
        system=prompt("task_specifier").filled(),
        turns=(Turn("user", (f"The request: {text}",)),),
        schema=schema_of(DenseDescription),
    )
    return session.generate(request, DenseDescription).description


def plan_layout(session: ModelSession, description: str) -> tuple[PlannedPart, ...]:
    """Return the parts of a described object with their sizes.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    request = Request(
        title="layout of the parts",
        system=prompt("layout_planner").filled(),
        turns=(Turn("user", (f"The object: {description}",)),),
        schema=schema_of(Layout),
    )
    return session.generate(request, Layout).parts


def annotate_parts(session: ModelSession, part_set: PartSet) -> dict[str, str]:
    """Return a caption of each part by name.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    names = sorted(mesh.name for mesh in part_set.meshes)

    def check(answer: PartCaptions) -> str:
        captioned = sorted(entry.part for entry in answer.captions)
        return "" if captioned == names else f"write one caption for each of {', '.join(names)}"

    evidence = Evidence(modality="text", parts=part_set.meshes, labels=part_set.labels)
    image = CaptionedImage("the object", front_image(part_set.meshes))
    request = Request(
        title="captions of the parts",
        system=prompt("part_annotator").filled(parts=describe_parts(evidence)),
        turns=(Turn("user", (image, parts_image(evidence))),),
        schema=schema_of(PartCaptions),
    )
    answer = session.generate(request, PartCaptions, check)
    return {entry.part: entry.caption for entry in answer.captions}


def build_parts(
    session: ModelSession, text: str, library: Sequence[LibraryObject]
) -> tuple[PartSet, TraceStep]:
    """Return separate parts for a described object, each centred at the origin.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: No object of the library can be read, or a request cannot be sent.
    """
    description = specify_task(session, text)
    planned = plan_layout(session, description)
    wanted = DetectedObject(description=description, kind=text, affordance="")
    pool: list[CaptionedPart] = []
    annotated = 0
    for candidate in candidates_for(session, wanted, library):
        try:
            part_set = candidate.load()
        except AssetError:
            continue
        captions = annotate_parts(session, part_set)
        pool += [
            CaptionedPart(
                f"{part_set.labels[name]}: {captions[name]}",
                part.pieces,
                part_set.source,
                part_set.licence,
            )
            for name, part in part_set.parts.items()
        ]
        annotated += 1
        if annotated == MAX_ANNOTATED:
            break
    if not pool:
        raise UsageError("no object of the selected categories can be read; give another --library")
    texts = [f"{part.name.replace('_', ' ')}: {part.description}" for part in planned]
    similarity = text_similarity(texts, [part.caption for part in pool])
    best = [pool[int(k)] for k in np.argmax(similarity, axis=1)]
    pieces = {
        plan.name: scaled_pieces(found.pieces, plan.size)
        for plan, found in zip(planned, best, strict=True)
    }
    sources = sorted({found.source for found in best})
    licences = sorted({found.licence for found in best})
    lines = [
        f"{plan.name}: {found.caption} ({found.source}, similarity {row.max():.2f})"
        for plan, found, row in zip(planned, best, similarity, strict=True)
    ]
    made = separate_part_set(
        "assembled", pieces, source=", ".join(sources), licence=", ".join(licences)
    )
    step = TraceStep(title=f"layout of {len(planned)} parts", text="\n".join([description, *lines]))
    return made, step


def scaled_pieces(pieces: Sequence[Piece], size: tuple[float, float, float]) -> tuple[Piece, ...]:
    """Return pieces scaled along x, y and z to ``size`` [m], their box centred at the origin."""
    corners = np.vstack([np.asarray(piece.mesh.bounds) for piece in pieces])
    low, high = corners.min(axis=0), corners.max(axis=0)
    factor = np.asarray(size) / np.maximum(high - low, MIN_SIDE_M)
    out = []
    for piece in pieces:
        mesh = piece.mesh.copy()
        mesh.vertices = (np.asarray(mesh.vertices) - 0.5 * (low + high)) * factor
        out.append(Piece(name=piece.name, mesh=mesh, rgba=piece.rgba, link=piece.link))
    return tuple(out)
