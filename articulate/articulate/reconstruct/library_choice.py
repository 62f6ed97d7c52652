"""Parts from a library of many objects, chosen by a model for a query.

For an image or video the most similar object is retrieved. For a text, parts of several objects are
scaled to a planned layout; they are yet to be placed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from articulate.errors import UsageError
from articulate.library import PartNetLibrary, ProceduralLibrary
from articulate.library.partnet import URDF_NAME
from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.vlm.layout import build_parts
from articulate.reconstruct.actors.vlm.options import ModelOptions
from articulate.reconstruct.actors.vlm.retrieval import LibraryObject, retrieve
from articulate.reconstruct.actors.vlm.schema import AnswerError
from articulate.reconstruct.part_set import PartSet, library_part_set
from articulate.reconstruct.query import Query

PROCEDURAL = "procedural"
"""Name of the entire procedural library."""
SEEDS = 8
"""Objects of each procedural category."""


def is_many(library: str) -> bool:
    """Return whether a library of ``--library`` has many objects to choose from."""
    if library == PROCEDURAL:
        return True
    try:
        folder = Path(library)
        return folder.is_dir() and not (folder / URDF_NAME).is_file()
    except OSError:
        return False


def open_objects(library: str) -> list[LibraryObject]:
    """Return the objects of a library.

    Args:
        library: ``procedural``, or a folder with the folders of PartNet-Mobility objects.

    Raises:
        UsageError: The folder contains no object.
    """
    if library == PROCEDURAL:
        source = ProceduralLibrary(SEEDS)
        return [
            LibraryObject(
                object_id=name, category=source.category(name), load=partial(library_part_set, name)
            )
            for name in source.ids()
        ]
    folder = PartNetLibrary(Path(library))
    return [
        LibraryObject(
            object_id=name,
            category=folder.category(name),
            load=partial(library_part_set, str(folder.folder / name)),
        )
        for name in folder.ids()
    ]


def choose_parts(query: Query, library: str, models: ModelOptions) -> PartSet:
    """Return parts for a query, chosen by a model.

    Raises:
        UsageError: The model gives no valid answer, no object can be read, or a request cannot be
            sent.
    """
    objects = open_objects(library)
    session = models.session()
    try:
        if query.modality == "text":
            found, step = build_parts(session, query.text, objects)
        else:
            evidence = Evidence(
                modality=query.modality,
                parts=(),
                video=query.video,
                times_s=query.times_s,
                image=query.image,
                text=query.text,
            )
            found, step = retrieve(session, evidence, objects)
    except AnswerError as invalid:
        raise UsageError(f"{query.description}: {invalid}") from None
    return replace(found, aligned=False, trace=(*session.steps, step))
