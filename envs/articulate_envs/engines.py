"""Choice of an engine by its name in a configuration."""

from __future__ import annotations

from collections.abc import Sequence

from articulate_envs.config import EngineName, WarpConfig
from articulate_envs.engine import Engine
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_envs.warp_engine import WarpEngine, warp_device


def make_engine(
    name: EngineName,
    scene: Scene | Sequence[Scene],
    n_envs: int,
    *,
    threads: int,
    warp: WarpConfig,
) -> Engine:
    """Return an engine with N environments.

    Args:
        name: Name of the engine.
        scene: Scene, or several for the engine on the CPU.
        n_envs: Number of environments.
        threads: Number of threads on the host.
        warp: Memory of the engine on MuJoCo Warp.

    Raises:
        EngineError: The engine does not support the scenes.
        MissingError: A package of the engine is not installed.
    """
    if name == "cpu":
        return ThreadEngine(scene, n_envs, threads=threads)
    return WarpEngine(scene, n_envs, threads=threads, config=warp)


def describe_engine(name: EngineName) -> str:
    """Return the name of an engine with that of its device.

    Raises:
        MissingError: A package of the engine is not installed.
    """
    if name == "cpu":
        return "cpu"
    device = warp_device()
    slow = "" if device.startswith("cuda") else ": no GPU, so much slower than the engine cpu"
    return f"warp on {device}{slow}"
