"""Mutated URDFs and meshes: an asset or one line, never a traceback, nothing elsewhere."""

from __future__ import annotations

import math
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from articulate.assets.asset import load_asset
from articulate.conversion import ConvertConfig, convert
from articulate.errors import ArticulateError
from articulate.simulator import mujoco
from mutants import BYTE_KINDS, ENCODINGS, MESHES, MOST, TREE_KINDS, Mutant, write_mutant

TIME_S = 60
"""Longest time of one conversion [s]."""
NUMBER = st.integers(0, MOST)
TREE = st.tuples(
    st.sampled_from(TREE_KINDS),
    NUMBER,
    NUMBER,
    NUMBER,
)
BYTES = st.tuples(st.sampled_from(BYTE_KINDS), NUMBER, NUMBER)


MUTANTS = st.builds(
    Mutant,
    tree=st.lists(TREE, max_size=4).map(tuple),
    text=st.one_of(st.just(()), st.lists(BYTES, max_size=2).map(tuple)),
    encoding=st.one_of(st.none(), st.none(), st.none(), st.sampled_from(ENCODINGS)),
    suffix=st.sampled_from(MESHES),
    mesh=st.one_of(st.just(()), st.lists(BYTES, max_size=3).map(tuple)),
)


@contextmanager
def at_most(seconds: int) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError(f"more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def everything_in(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*")}


def check(mutant: Mutant) -> None:
    """Convert one mutant; anything but an asset or an error of ours fails."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        folder = Path(name)
        path = write_mutant(mutant, folder)
        before = everything_in(folder)
        out = folder / "made" / "out"
        config = ConvertConfig(decompose=False)
        try:
            with at_most(TIME_S):
                asset = convert(path, out, config)
        except ArticulateError as error:
            line = str(error)
        else:
            line = ""
        if line:
            event("refused")
            assert "\n" not in line
            assert len(line) < 8000
            assert everything_in(folder) - before <= {"made"}
            return
        event("converted")
        assert {p.split("/")[0] for p in everything_in(folder) - before} == {"made"}
        assert [p.name for p in (folder / "made").iterdir()] == ["out"]
        assert load_asset(out) == asset
        model = mujoco.MjModel.from_xml_path(str(asset.mjcf_path))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert np.isfinite(data.xpos).all()
        assert np.isfinite(model.body_mass).all()
        for joint in asset.joints:
            assert math.isfinite(joint.span)
            assert np.linalg.norm(joint.axis_o) == pytest.approx(1.0)


@given(MUTANTS)
@settings(max_examples=30, suppress_health_check=list(HealthCheck))
def test_mutants_give_an_asset_or_one_line(mutant: Mutant) -> None:
    check(mutant)


@pytest.mark.slow
@given(MUTANTS)
@settings(
    max_examples=int(os.environ.get("ARTICULATE_FUZZ", "2000")),
    suppress_health_check=list(HealthCheck),
)
def test_two_thousand_mutants_give_an_asset_or_one_line(mutant: Mutant) -> None:
    check(mutant)


def test_the_seed_itself_is_converted_in_every_format(tmp_path: Path) -> None:
    for suffix in MESHES:
        folder = tmp_path / suffix[1:]
        folder.mkdir()
        path = write_mutant(Mutant((), (), None, suffix, ()), folder)
        asset = convert(path, folder / "out", ConvertConfig(decompose=False))
        assert [joint.name for joint in asset.joints] == ["slide", "turn"]
        assert asset.link("drawer").visuals == 3
