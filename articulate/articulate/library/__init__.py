"""Where objects come from: a protocol, and procedural objects that are ours to give."""

from articulate.library.library import Library
from articulate.library.procedural.cabinet import CabinetLibrary

__all__ = ["CabinetLibrary", "Library"]
