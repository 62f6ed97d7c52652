"""Sources of objects: the protocol, the procedural library (MIT) and PartNet-Mobility."""

from articulate.library.library import Library, open_library
from articulate.library.partnet import PartNetLibrary
from articulate.library.procedural.library import ProceduralLibrary

__all__ = ["Library", "PartNetLibrary", "ProceduralLibrary", "open_library"]
