from __future__ import annotations

import importlib.util
import os
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.articulate.reconstruct.actors.vlm.server import Server, in_turn

from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint
from articulate.reconstruct.actors.vlm.http_model import MODEL_VARIABLE
from articulate.reconstruct.actors.vlm.providers import FORMATS, create_model
from articulate.render.camera import front_camera
from articulate.render.joint_video import poses_of_parts, render_video, sweep_positions
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene

KEY = "AIza-this-is-the-secret-key"
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


QUICK: dict[str, Any] = {
    "attempts": 3,
    "first_wait_s": 0.01,
    "longest_wait_s": 1.0,
    "timeout_s": 20.0,
}


@pytest.fixture
def client():
    """Skip where httpx is not installed."""
    if importlib.util.find_spec("httpx") is None:
        pytest.skip("httpx is not installed (extra vlm)")


@pytest.fixture(autouse=True)
def _surroundings(monkeypatch, tmp_path):
    """Remove this machine's settings, and use a temporary cache."""
    proxies = [name for name in os.environ if name.lower().endswith("_proxy")]
    certificates = ("SSL_CERT_FILE", "SSL_CERT_DIR")
    formats = [v for f in FORMATS.values() for v in (*f.key_variables, f.url_variable)]
    for name in (*formats, MODEL_VARIABLE, *proxies, *certificates):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("articulate.reconstruct.actors.vlm.actor.N_EXAMPLES", 0)  # they take time


@pytest.fixture
def serve(client, monkeypatch):
    """``serve(*answers)`` or ``serve(function)``: a scripted server for all providers."""
    with ExitStack() as stack:

        def start(*answers):
            answer = answers[0] if callable(answers[0]) else in_turn(*answers)
            server = stack.enter_context(Server(answer))
            for provider, wire_format in FORMATS.items():
                base = f"{server.url}/v1" if provider == "openai" else server.url
                monkeypatch.setenv(wire_format.url_variable, base)
                monkeypatch.setenv(wire_format.key_variables[-1], KEY)
            return server

        yield start


@pytest.fixture
def gemini():
    """A model that does not wait long."""
    return replace(create_model("gemini:gemini-3.8-flash"), **QUICK)


@pytest.fixture(params=["gemini", "openai", "anthropic"])
def model(request):
    """A model of each provider."""
    return replace(create_model(f"{request.param}:scripted"), **QUICK)


def box(name, low, high, rgb):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    vertices = np.asarray(low) + corners * (np.asarray(high) - np.asarray(low))
    return plain_part(name, vertices, FACES, rgb)


PARTS = (
    box("part_00", (-0.4, -0.6, 0.0), (-0.3, 0.6, 1.4), (0.7, 0.6, 0.5)),
    box("part_01", (-0.3, -0.6, 0.0), (0.3, 0.6, 0.7), (0.6, 0.6, 0.7)),
    box("part_02", (0.3, 0.05, 0.75), (0.34, 0.6, 1.35), (0.3, 0.5, 0.8)),
    box("part_03", (0.34, 0.1, 1.0), (0.37, 0.14, 1.2), (0.2, 0.2, 0.2)),
)
LABELS = {"part_00": "back", "part_01": "body", "part_02": "door", "part_03": "handle"}
DOOR = PredictedJoint(
    part="part_02",
    parent="part_01",
    kind="revolute",
    axis_o=(0.0, 0.0, 1.0),
    pivot_o=(0.3, 0.6, 0.0),
    lower=0.0,
    upper=1.4,
)
DOOR_PROGRAM = """\
root("part_01")
d = box("part_02")
hinge = vec(d.low.x, d.high.y, 0)
revolute("part_02", "part_01", axis=vec(0, 0, 1), pivot=hinge, lower=0.0, upper=1.4)
fixed("part_03", "part_02")
fixed("part_00", "part_01")
"""


@pytest.fixture(scope="session")
def video():
    """A cupboard whose door opens, before a known camera."""
    camera = front_camera(240, 180)
    poses = poses_of_parts(4, [2, 3], DOOR.T_o(sweep_positions(DOOR.lower, DOOR.upper, 14)))
    clip = render_video(PartScene(PARTS), camera, poses)
    return Evidence(
        modality="video",
        parts=PARTS,
        labels=LABELS,
        video=clip.frames,
        times_s=clip.times_s,
        camera=camera,
    )


@pytest.fixture(scope="session")
def image(video):
    return Evidence(
        modality="image", parts=PARTS, labels=LABELS, image=video.video[0], camera=video.camera
    )


@pytest.fixture(scope="session")
def text():
    return Evidence(modality="text", parts=PARTS, labels=LABELS, text="a cupboard")
