"""Removal of an API key from texts that a server sends back."""

from __future__ import annotations

import json
import re
from typing import Any

from articulate.errors import shorten

HIDDEN = "(key)"
MAX_REASON = 200
"""Most characters of a server's reason in an error line."""
ESCAPED = re.compile(r"""\\(?:u([0-9a-fA-F]{4})|x([0-9a-fA-F]{2})|(["/\\]))""")
"""An escaped character in JSON or in a program."""


def short_reason(text: str, key: str) -> str:
    """Return one line of at most :data:`MAX_REASON` characters without the key."""
    return shorten(" ".join(hide(text, key).split()), MAX_REASON)


def hide_in_answer(text: str, key: str) -> str:
    """Remove the key from an answer, also where JSON escapes characters of it."""
    if not key:
        return text
    plain = hide(text, key)
    try:
        content = json.loads(text)
        clean = hide_in_value(content, key)
        return text if clean == content and plain == text else json.dumps(clean)
    except (ValueError, RecursionError):  # it is not JSON, or nested too deeply
        return plain


def hide_in_value(value: Any, key: str) -> Any:
    """Replace the key in all texts of a JSON value."""
    if isinstance(value, str):
        return hide(value, key)
    if isinstance(value, list):
        return [hide_in_value(one, key) for one in value]
    if isinstance(value, dict):
        return {hide(name, key): hide_in_value(one, key) for name, one in value.items()}
    return value


def hide(text: str, key: str) -> str:
    """Replace the key in a text, written plainly or with escapes."""
    if not key:
        return text
    text = text.replace(key, HIDDEN)
    plain = ESCAPED.sub(_unescape, text)
    return plain.replace(key, HIDDEN) if key in plain else text


def _unescape(found: re.Match[str]) -> str:
    return found[3] or chr(int(found[1] or found[2], 16))
