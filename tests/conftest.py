"""What tests of all packages share: objects that are not ours to give, and the lines users read."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings

from articulate.errors import UsageError

ROOT = Path(__file__).resolve().parents[1]
LINES_PATH = Path(__file__).with_name("error_lines.txt")
LINES_HEADER = """\
# What users read when something is wrong with what they gave: the provoking call, then the line.
# A test provokes each of them (fixture error_line). New and changed ones are written, sorted, by
# .venv/bin/python -m pytest --rewrite-error-lines; those that nothing provokes are deleted by hand.
"""

# Machines that test may be busy: time decides nothing. In CI the same examples each time.
settings.register_profile(
    "project",
    deadline=None,
    derandomize="CI" in os.environ,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("project")


# What a shell starts in the background ignores SIGINT, and so would all that tests start.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--rewrite-error-lines", action="store_true", help="write tests/error_lines.txt"
    )


@pytest.fixture(scope="session", autouse=True)
def results_from_memory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """All tests and workers share the results of searching a placement and exporting a network."""
    base = tmp_path_factory.getbasetemp()
    is_worker = "PYTEST_XDIST_WORKER" in os.environ
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARTICULATE_TEST_RESULTS", str((base.parent if is_worker else base) / "kept"))
        if "articulate_envs.joint_selection" in sys.modules:
            from tests.placements import find_placement

            patch.setattr("articulate_envs.joint_selection.find_placement", find_placement)
        if "articulate_train.export" in sys.modules:
            from tests.networks import to_onnx

            patch.setattr("articulate_train.export.to_onnx", to_onnx)
        yield


@pytest.fixture
def short_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search of a placement ends after its first stage, for objects that have none."""
    from articulate_envs import placement_search

    monkeypatch.setattr(placement_search, "SEARCH_STAGES", placement_search.SEARCH_STAGES[:1])
    monkeypatch.setattr(placement_search, "MAX_TRIES", 1)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder that the paths of ``assets.json`` start from; skips where there is none.

    ``ARTICULATE_DATA`` names it; by default it lies beside the checkout. A packed archive is
    unpacked once, into the user's cache.
    """
    default = ROOT.parent / "shared" / "data"
    folder = Path(os.environ.get("ARTICULATE_DATA", default))
    if (folder / "assets").is_dir():
        return folder
    archive = folder / "assets.tar.xz"
    if not archive.is_file():
        pytest.skip(
            f"no objects in {folder}: set ARTICULATE_DATA to a folder with assets.json and assets/"
        )
    stat = archive.stat()
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "articulate"
    unpacked = cache / f"data-{stat.st_size}-{int(stat.st_mtime)}"
    if not unpacked.is_dir():
        cache.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=".data-", dir=cache))
        with tarfile.open(archive) as tar:
            tar.extractall(partial, filter="data")
        shutil.copy(folder / "assets.json", partial)
        try:
            partial.rename(unpacked)
        except OSError:  # another worker was first
            shutil.rmtree(partial)
    return unpacked


@pytest.fixture(scope="session")
def data_index(data_folder: Path) -> list[dict[str, object]]:
    """The entries of ``assets.json``."""
    entries: list[dict[str, object]] = json.loads((data_folder / "assets.json").read_text())[
        "assets"
    ]
    return entries


@pytest.fixture
def error_line(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., str]:
    """``error_line(call, provoke)``: what ``provoke()`` complains of is the line kept for ``call``.

    ``call`` says in source text what is called; paths below ``tmp_path`` are shortened.
    """

    def check(call: str, provoke: Callable[[], object]) -> str:
        with pytest.raises(UsageError) as caught:
            provoke()
        line = str(caught.value).replace(f"{tmp_path}/", "").replace(str(ROOT), "<checkout>")
        assert "\n" not in line
        lines = read_error_lines()
        if request.config.getoption("--rewrite-error-lines"):
            with FileLock(LINES_PATH.with_suffix(".lock")):
                write_error_lines({**read_error_lines(), call: line})
        else:
            assert lines.get(call) == line, "see the header of tests/error_lines.txt"
        return line

    return check


def read_error_lines() -> dict[str, str]:
    text = LINES_PATH.read_text(encoding="utf-8") if LINES_PATH.exists() else ""
    rows = [row for row in text.splitlines() if row and not row.startswith("#")]
    return {call: line.strip() for call, line in zip(rows[::2], rows[1::2], strict=True)}


def write_error_lines(lines: dict[str, str]) -> None:
    entries = [f"{call}\n    {lines[call]}\n" for call in sorted(lines)]
    LINES_PATH.write_text("\n".join([LINES_HEADER, *entries]), encoding="utf-8")
