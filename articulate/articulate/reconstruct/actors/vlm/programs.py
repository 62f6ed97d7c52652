"""Programs of models: run in the sandbox and converted to joints and placements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import trimesh

from articulate.errors import shorten
from articulate.formats.load_meshes import GREY, Piece
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.actors.vlm.answers import ProgramAnswer
from articulate.reconstruct.actors.vlm.model import Request
from articulate.reconstruct.actors.vlm.model_session import MAX_ECHO, ModelSession
from articulate.reconstruct.actors.vlm.schema import MAX_ERROR, AnswerError
from articulate.reconstruct.program.program_parts import Parts, ProgramPart
from articulate.reconstruct.program.result import ObjectJoint, ProgramError, ProgramObject
from articulate.reconstruct.program.run import run_program
from articulate.render.parts import PartMesh
from articulate.transforms import Array, pose, quat_to_matrix

MAX_PROGRAMS = 4
"""Most programs of a model until one runs."""
MOVED_M = 1e-6
"""Displacement above which a part counts as moved [m]."""


def parts_of_meshes(meshes: Sequence[PartMesh]) -> Parts:
    """Convert meshes to parts of a program, in the same frame."""
    return Parts({mesh.name: ProgramPart(mesh.name, partial(_pieces, mesh)) for mesh in meshes})


def runnable_program(
    session: ModelSession,
    request: Request,
    meshes: Sequence[PartMesh],
    error_of: Callable[[ProgramObject], str],
) -> tuple[str, ProgramObject]:
    """Return a program of the model that runs, and the object that it describes.

    Errors of the sandbox are sent back to the model with line and column.

    Args:
        session: Session with the model.
        request: Request for a program.
        meshes: Parts that the program may use.
        error_of: Function that returns the error of a described object; empty if it is valid.

    Raises:
        AnswerError: No program runs.
        UsageError: The request cannot be sent.
    """
    parts = parts_of_meshes(meshes)
    error = ""
    for _ in range(MAX_PROGRAMS):
        answer = session.generate(request, ProgramAnswer)
        source = _unfenced(answer.program)
        found = run_program(source, parts)
        error = str(found) if isinstance(found, ProgramError) else error_of(found)
        if isinstance(found, ProgramObject) and not error:
            return source, found
        request = request.after(
            source[:MAX_ECHO],
            f"The program is invalid: {error}\nCorrect it and write the complete program.",
        )
    reason = shorten(error, MAX_ERROR)
    raise AnswerError(f"{session.model.name}: {MAX_PROGRAMS} invalid programs in a row; {reason}")


def program_joints(built: ProgramObject) -> tuple[PredictedJoint, ...]:
    """Convert all joints of an object, fixed ones included."""
    at = {part.name: part.pos_w for part in built.parts}
    return tuple(_joint(joint, at[joint.child]) for joint in built.joints)


def placements_in(built: ProgramObject) -> dict[str, Array]:
    """Return the pose (4, 4) of each part with geometry, by name."""
    return {
        part.name: pose(np.asarray(part.pos_w), quat_to_matrix(np.asarray(part.quat_w)))
        for part in built.parts
        if part.geometry
    }


def joints_error(built: ProgramObject) -> str:
    """Return the error of an object whose parts were placed before; empty if it is valid."""
    for name, T in placements_in(built).items():
        if np.abs(T - np.eye(4)).max() > MOVED_M:
            return f"it moves {name}, but all parts are placed: join them where they are"
    if any(not part.geometry for part in built.parts):
        return "it makes a frame, which is not a part; join parts with each other"
    if all(joint.kind == "fixed" for joint in built.joints):
        return "nothing moves in it; join what moves with revolute, prismatic or continuous"
    return ""


def _joint(joint: ObjectJoint, own_o: tuple[float, float, float]) -> PredictedJoint:
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
    """Remove the fence that models put around code."""
    lines = program.strip().splitlines()
    if len(lines) >= 2 and lines[0].startswith("```") and lines[-1].strip() == "```":
        lines = lines[1:-1]
    return "\n".join(lines) + "\n"
