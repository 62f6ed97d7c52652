"""Where objects come from: a protocol, and procedural objects that are ours to give."""

from articulate.library.library import Library
from articulate.library.procedural.library import ProceduralLibrary

__all__ = ["Library", "ProceduralLibrary"]
