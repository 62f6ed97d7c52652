"""Where objects come from: a protocol, procedural objects that are ours to give, data sets."""

from articulate.library.library import Library, open_library
from articulate.library.partnet import PartNetLibrary
from articulate.library.procedural.library import ProceduralLibrary

__all__ = ["Library", "PartNetLibrary", "ProceduralLibrary", "open_library"]
