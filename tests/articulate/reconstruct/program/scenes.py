"""Parts of our own for tests: a hollow cabinet, a drawer, a door, a handle."""

from __future__ import annotations

import trimesh

from articulate.reconstruct.program.result import ProgramError, ProgramObject
from articulate.reconstruct.program.run import compile_program, run_program


def box(size, centre=(0.0, 0.0, 0.0)):
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(centre))


def cabinet():
    """A carcass of 0.4 (x) by 0.5 (y) by 0.7 (z), walls of 0.02, open to the front (+x)."""
    return trimesh.util.concatenate(
        [
            box((0.4, 0.5, 0.02), (0, 0, 0.01)),
            box((0.4, 0.5, 0.02), (0, 0, 0.69)),
            box((0.02, 0.5, 0.66), (-0.19, 0, 0.35)),
            box((0.38, 0.02, 0.66), (0.01, -0.24, 0.35)),
            box((0.38, 0.02, 0.66), (0.01, 0.24, 0.35)),
        ]
    )


def parts():
    """Meshes by name, each about its own origin but for the body."""
    return {
        "body": cabinet(),
        "drawer": box((0.36, 0.45, 0.2)),
        "door": box((0.02, 0.5, 0.3)),
        "handle": box((0.03, 0.12, 0.02)),
    }


def built(source, given, limits=None) -> ProgramObject:
    """What a program that runs gives."""
    found = run_program(source, given, limits)
    assert isinstance(found, ProgramObject), found
    return found


def refused(source, given, limits=None) -> ProgramError:
    """Why a program that does not run is refused."""
    found = run_program(source, given, limits)
    assert isinstance(found, ProgramError), found
    return found


def compiled(source, given, out, name="object"):
    """URDF of a program that runs."""
    found = compile_program(source, given, out, name=name)
    assert not isinstance(found, ProgramError), found
    return found


PROGRAM = """
place_relative_to("drawer", "body", "below_inside", align=True)
place_relative_to("drawer", "body", "back_inside")
place_relative_to("door", "body", "front", align=True)
move("door", (0, 0, 0.2))
d = box("door")
place_relative_to("handle", "door", "front", align=True)
move("handle", (0, 0.2, 0))
fixed("handle", "door")
revolute("door", "body", axis=(0, 0, -1), pivot=(d.low.x, d.low.y, d.centre.z),
         lower=0, upper=radians(100), name="door_hinge")
prismatic("drawer", "body", axis=(1, 0, 0), lower=0, upper=0.3)
material("door", "glass")
"""
