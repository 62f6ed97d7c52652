"""What an actor may be given of an object."""

from __future__ import annotations

from typing import Literal

Modality = Literal["text", "image", "video"]
