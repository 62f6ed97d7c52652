"""From a URDF to an asset folder: MJCF, canonical URDF, meshes, and a record of every change."""

from articulate.conversion.convert import convert
from articulate.formats.config import ConvertConfig

__all__ = ["ConvertConfig", "convert"]
