import json
import math
import time

import pytest

from articulate.commands import main
from articulate.commands.cache import CacheFlags


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of three entries."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "articulate"
    for k, kind in enumerate(["assets", "assets", "decompositions"]):
        path = folder / kind / f"entry_{k}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x" * 1000 * (k + 1))
    time.sleep(0.01)
    return folder


def test_entries_are_listed_by_kind_and_size(cache, capsys):
    assert main(["cache"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"{cache}: 3 entries, 6.0 kB of at most 20.0 GB\n")
    assert "  assets                2 entries     3.0 kB\n" in text
    assert text.index("entry_2") < text.index("entry_1") < text.index("entry_0")
    assert main(["cache", "list", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["bytes"] == 6000
    assert {e["name"] for e in content["entries"]} == {"entry_0", "entry_1", "entry_2"}


def test_cleaning_keeps_as_much_as_is_requested(cache, capsys):
    assert main(["cache", "clean", "--keep-gb", "0.000005", "--json"]) == 0
    done = json.loads(capsys.readouterr().out)
    assert done["left_bytes"] <= 5000
    assert done["removed"] + done["left"] == 3
    assert main(["cache", "clean"]) == 0
    assert "0 left (0 B)" in capsys.readouterr().out
    assert not any(path.is_file() for path in (cache / "assets").iterdir())


def test_a_size_that_is_not_finite_is_rejected(error_line):
    error_line("cache clean --keep-gb inf", lambda: CacheFlags(action="clean", keep_gb=math.inf))


def test_an_empty_cache_is_listed_and_nothing_is_made(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert main(["cache", "list"]) == 0
    assert "0 entries" in capsys.readouterr().out
    assert main(["cache", "clean"]) == 2
    assert "there is no cache yet" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
