"""What a policy does in drawn episodes from home, tick by tick, for commands that look closer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from articulate.task.randomization import EpisodeParams, draw
from articulate.transforms import Array, Ints, Mask
from articulate_envs.compiled.reward import HELD_SHARE
from articulate_envs.initial_states import home_start
from articulate_envs.rewards import grasp_of
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.evaluate import run_drawn
from articulate_train.policy import load_policy
from articulate_train.run import open_run


@dataclass(frozen=True)
class Watched:
    """What N episodes did at each of T ticks, all but the last, after which they begin anew."""

    scene: Scene
    """Where."""
    place_t: Array
    """The handle's middle in the frame of the tool (T, N, 3) [m]."""
    depth: Array
    """Of the tool beyond the handle's middle, along the handle's approach (T, N) [m]."""
    closing: Mask
    """Whether fingers close or are closed (T, N)."""
    width: Array
    """Opening between them (T, N) [m]."""
    force: Array
    """Filtered (T, N) [N]."""
    opened: Array
    """Fraction open (T, N)."""
    code: Ints
    """How the episodes ended (N,): codes of :data:`articulate.task.episode_monitor.REASONS`."""
    drawn: EpisodeParams
    """What was drawn for them."""

    @property
    def thick(self) -> Array:
        """What there is to hold (N,) [m]."""
        handle = self.scene.asset.handle_of(self.scene.task.joint)
        return np.asarray(grasp_of(handle).thick_m * self.drawn["scale"])

    @property
    def least(self) -> Array:
        """Fingers that are nearer than this hold nothing (N,) [m]."""
        return HELD_SHARE * self.thick


def told_deeper(drawn: EpisodeParams, T_wh: Array, deeper_m: float) -> EpisodeParams:
    """As ``drawn``, with handles at poses (N, 4, 4) told so much deeper along their approach."""
    told = EpisodeParams(drawn.values.copy())
    told["bias"][:] += deeper_m * T_wh[:, :3, 2]
    return told


def handles(scene: Scene, drawn: EpisodeParams) -> Array:
    """Poses of the handles ``T_wh`` (N, 4, 4) as episodes begin."""
    count = len(drawn.values)
    engine = ThreadEngine(scene, count, threads=1)
    try:
        engine.reset(np.arange(count), home_start(scene, drawn))
        return engine.state().T_wh.copy()
    finally:
        engine.close()


def watch(
    folder: Path,
    seed: int,
    *,
    episodes: int,
    draws: int,
    ranges: float = 1.0,
    deeper_m: float = 0.0,
    threads: int = 2,
) -> Watched:
    """Run a policy's drawn episodes from home, with its mean action.

    Args:
        folder: Run.
        seed: Which of its policies.
        episodes: So many.
        draws: Seed of what is drawn.
        ranges: So many times as wide is every range of the randomisation.
        deeper_m: So much deeper than it is the handle is told to be [m].
        threads: Threads of the engine.
    """
    run = open_run(folder).widened(ranges)
    scene, policy = run.scene(), load_policy(run.seed_folder(seed))
    first, second = np.random.SeedSequence(draws).spawn(2)
    drawn = draw(run.config.draw, np.random.default_rng(first), episodes, begin=scene.task.begin)
    if deeper_m:
        drawn = told_deeper(drawn, handles(scene, drawn), deeper_m)
    place: list[Array] = []
    depth: list[Array] = []
    closing: list[Mask] = []
    width: list[Array] = []
    force: list[Array] = []
    opened: list[Array] = []

    def look(_: int, __: slice, engine: ThreadEngine) -> None:
        state = engine.state()
        to_handle = state.T_wh[:, :3, 3] - state.T_wt[:, :3, 3]
        place.append(np.einsum("nij,ni->nj", state.T_wt[:, :3, :3], to_handle))
        depth.append(-np.einsum("ni,ni->n", state.T_wh[:, :3, 2], to_handle))
        closing.append(state.hand.closing > 0.0)
        width.append(state.hand_width.copy())
        force.append(np.linalg.norm(state.samples[:, :3], axis=1))
        opened.append(state.opened.copy())

    ended = run_drawn(
        scene,
        policy,
        run.config.draw,
        drawn,
        second,
        threads=threads,
        after_tick=look,
        side_by_side=episodes,
    )
    return Watched(
        scene=scene,
        place_t=np.array(place),
        depth=np.array(depth),
        closing=np.array(closing),
        width=np.array(width),
        force=np.array(force),
        opened=np.array(opened),
        code=ended.code,
        drawn=drawn,
    )
