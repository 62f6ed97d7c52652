"""From a URDF to an asset folder: MJCF, canonical URDF, meshes, and a record of every change."""

from articulate.convert.config import ConvertConfig
from articulate.convert.convert import convert

__all__ = ["ConvertConfig", "convert"]
