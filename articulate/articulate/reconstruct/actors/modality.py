"""Kinds of evidence."""

from __future__ import annotations

from typing import Literal

Modality = Literal["text", "image", "video"]
