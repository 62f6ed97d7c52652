"""What mkdocs does besides: the README becomes the first page; links out of docs/ become names.

The documents are read in the repository too, where such links work; a site has no such files.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
OUTWARD = re.compile(r"!?\[([^\]]*)\]\((?:\.\./)+([^)\s]*)\)")
INWARD = re.compile(r"\]\(docs/([^)\s]*)\)")
OF_README = re.compile(r"(?<!!)\[([^\]]*)\]\((?!https?:|docs/|#)([^)\s]*)\)")


def on_files(files: Files, config: Any) -> Files:
    """Put the README in as the first page."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    text = INWARD.sub(r"](\1)", OF_README.sub(r"\1 (`\2`)", text))
    files.append(File.generated(config, "index.md", content=text))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Name what lies outside of docs/ instead of linking it."""
    if "/" in page.file.src_uri:  # ../ of docs/commands/ is docs/
        return re.sub(r"!?\[([^\]]*)\]\(\.\./\.\./([^)\s]*)\)", r"\1 (`\2`)", markdown)
    return OUTWARD.sub(r"\1 (`\2`)", markdown)
