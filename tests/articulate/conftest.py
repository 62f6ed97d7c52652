"""How tests of the MJCF reader run MuJoCo."""

from __future__ import annotations

import pytest

from articulate.formats import read_mjcf as reading
from articulate.formats import read_mjcf_child


@pytest.fixture
def in_child() -> None:
    """For tests in which MuJoCo reads in a process of its own, as it does outside of tests."""


@pytest.fixture
def quick(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the others it reads here: a process takes 0.4 s."""
    if "in_child" not in request.fixturenames:
        monkeypatch.setattr(
            reading, "run_child", lambda text, meshes: read_mjcf_child.answer(text.text, meshes)
        )
