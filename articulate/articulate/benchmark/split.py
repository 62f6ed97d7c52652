"""Fixed split of objects and videos into a development half and a published half."""

from __future__ import annotations

import hashlib
from typing import Literal

Half = Literal["development", "published"]


def half(item: str) -> Half:
    """Return the half of an object, video or image by the SHA-256 of its id.

    Parameters are chosen on the development half; figures of the published half are reported.
    """
    digest = hashlib.sha256(item.encode()).hexdigest()
    return "published" if int(digest, 16) % 2 else "development"
