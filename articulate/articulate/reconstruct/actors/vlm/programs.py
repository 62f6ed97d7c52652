"""Programs of models: run in the sandbox, and read as joints and places."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import trimesh

from articulate.formats.load_meshes import GREY, Piece
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.actors.vlm.answers import ProgramAnswer
from articulate.reconstruct.actors.vlm.model import Request
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.schema import Unfit
from articulate.reconstruct.program.program_parts import PartMesh as ProgramPart
from articulate.reconstruct.program.program_parts import Parts
from articulate.reconstruct.program.result import Built, BuiltJoint, ProgramError
from articulate.reconstruct.program.run import run_program
from articulate.render.parts import PartMesh
from articulate.transforms import Array, pose, quat_to_matrix

TRIES = 4
"""Programs that a model may write until one runs."""
MOVED_M = 1e-6
"""A part that is farther from where it was given was moved."""


def parts_of_meshes(meshes: Sequence[PartMesh]) -> Parts:
    """Parts for programs, in the frame of the meshes."""
    return Parts({mesh.name: ProgramPart(mesh.name, partial(_pieces, mesh)) for mesh in meshes})


def written(
    interview: ModelSession,
    request: Request,
    meshes: Sequence[PartMesh],
    wrong: Callable[[Built], str],
) -> tuple[str, Built]:
    """A program that runs, and what it describes.

    What the sandbox refuses goes back to the model with line and column.

    Args:
        interview: Who is asked.
        request: The question.
        meshes: Parts that the program may use.
        wrong: Says what is wrong with an object that a program describes; empty if nothing is.

    Raises:
        Unfit: No program runs.
        UsageError: The model cannot be asked.
    """
    parts = parts_of_meshes(meshes)
    said = ""
    for _ in range(TRIES):
        answer = interview.ask(request, ProgramAnswer)
        source = _unfenced(answer.program)
        found = run_program(source, parts)
        said = str(found) if isinstance(found, ProgramError) else wrong(found)
        if isinstance(found, Built) and not said:
            return source, found
        request = request.after(
            source, f"The program is refused: {said}\nWrite the whole program again, mended."
        )
    raise Unfit(f"{interview.model.name}: {TRIES} programs in a row are refused; {said}")


def joints_in(built: Built) -> tuple[PredictedJoint, ...]:
    """All joints of an object, also fixed ones."""
    at = {part.name: part.pos_w for part in built.parts}
    return tuple(_joint(joint, at[joint.child]) for joint in built.joints)


def places_in(built: Built) -> dict[str, Array]:
    """Where each part was put (4, 4), by name."""
    return {
        part.name: pose(np.asarray(part.pos_w), quat_to_matrix(np.asarray(part.quat_w)))
        for part in built.parts
        if part.geometry
    }


def wrong_joints(built: Built) -> str:
    """What is wrong with an object whose parts were in their places; empty if nothing is."""
    for name, T in places_in(built).items():
        if np.abs(T - np.eye(4)).max() > MOVED_M:
            return f"it moves {name}, and all parts are in their places: join them where they are"
    if any(not part.geometry for part in built.parts):
        return "it makes a frame, which is no part; join parts with each other"
    if all(joint.kind == "fixed" for joint in built.joints):
        return "nothing moves in it; join what moves with revolute, prismatic or continuous"
    return ""


def _joint(joint: BuiltJoint, own_o: tuple[float, float, float]) -> PredictedJoint:
    return PredictedJoint(
        part=joint.child,
        parent=joint.parent,
        kind=joint.kind,
        axis_o=joint.axis_w or (0.0, 0.0, 1.0),
        pivot_o=joint.pivot_w or own_o,
        lower=joint.lower,
        upper=joint.upper,
    )


def _pieces(mesh: PartMesh) -> tuple[Piece, ...]:
    shape = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return (Piece(name=mesh.name, mesh=shape, rgba=GREY, link=mesh.name),)


def _unfenced(program: str) -> str:
    """A program without the fence that models like to put around code."""
    lines = program.strip().splitlines()
    if len(lines) >= 2 and lines[0].startswith("```") and lines[-1].strip() == "```":
        lines = lines[1:-1]
    return "\n".join(lines) + "\n"
