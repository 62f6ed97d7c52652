"""How episodes begin: from home, or along the task while learning; and when these are cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from articulate.draw import COLUMNS, Draw, DrawConfig, draw
from articulate.errors import ConfigError
from articulate.kinematics import solve_ik
from articulate.placing import handle_in_world
from articulate.transforms import Array, pose
from articulate_envs.engine import Start
from articulate_envs.rewards import check_until

if TYPE_CHECKING:  # configurations are light to import, scenes are not
    from articulate_envs.scene import Scene


@dataclass(frozen=True, kw_only=True)
class StartConfig:
    """Share of training episodes that begin along the task, how, and when training cuts them."""

    share_first: float = 0.8
    """Share of starts along the task at the beginning of training, in [0, 1]."""
    share_last: float = 0.2
    """Share at the end of the curriculum, in [0, 1]."""
    until: float = 0.6
    """Share of the training after which the second holds; linear between."""
    grip_share: float = 0.45
    """Of those starts, the share with the hand closed on the handle of a part on its way."""
    standoff_m: float = 0.12
    """The others begin before the handle, up to this far [m]; the part is where it begins."""
    empty_share: float = 0.3
    """Of those before the handle, the share with a hand that has closed on nothing, which learns
    to open again."""
    empty_m: float = 0.016
    """How far before the handle such a hand is at least [m]."""
    closing_share: float = 0.4
    """Of those before the handle, the share that is at it with an open hand that has just been
    told to close: what closing there leads to is met before the policy has learnt to want it."""
    astray_share: float = 0.15
    """Of those before the handle, the share that lies to one side of it, which learns not to push
    a finger against its front."""
    astray_m: tuple[float, float] = (0.04, 0.06)
    """How far before the handle such a hand is at least, and to either side at most [m]."""
    bank: int = 512
    """How many such starts are prepared."""
    cut: float = 0.04
    """Chance, each tick, that an episode of training ends once its part has rested at the target
    as long as success asks for. Such an end counts as cut off (a truncation), and the time is
    spent on the next episode: else most of all ticks would show a part at rest."""
    cut_share: float = 0.5
    """Share of the environments in which episodes are cut, in [0, 1). In the others the part is
    held to the end, which has to be learnt too; what training says of successes is of these."""

    def __post_init__(self) -> None:
        check_until("starts", self.until)
        if not 0.0 <= self.cut_share < 1.0:
            raise ConfigError(
                f"starts.cut_share is {self.cut_share}; it must be at least 0 and below 1"
            )

    def share(self, progress: float) -> float:
        """Share of starts along the task when ``progress`` in [0, 1] of the training is done."""
        done = min(max(progress / self.until, 0.0), 1.0)
        return self.share_first + done * (self.share_last - self.share_first)


def home_start(scene: Scene, drawn: Draw) -> Start:
    """Starts from home plus the drawn offsets, hand open and empty, part where it was drawn."""
    n, opened = len(drawn.values), drawn["part_open"].copy()
    first, last = scene.task.begin
    assert np.all((opened >= first) & (opened <= last)), "drawn without the task's begin"
    low, high = scene.arm.bounds(scene.follow.margin_rad)
    return Start(
        draw=drawn,
        q=np.clip(np.asarray(scene.place.start_q) + drawn["start"], low, high),
        opened=opened,
        width=np.full(n, scene.arm.hand.max_width_m),
        closing=-np.ones(n),
        home=np.ones(n, dtype=bool),
    )


def bank_of_starts(
    scene: Scene, config: StartConfig, draws: DrawConfig, rng: np.random.Generator
) -> Start:
    """Starts along the task whose arm poses were found by inverse kinematics."""
    n = config.bank
    task = scene.task
    drawn = draw(draws, rng, n, begin=task.begin)
    grip = rng.random(n) < config.grip_share
    on_way = task.begin[1] + (task.target - task.begin[1]) * rng.random(n)
    opened = np.where(grip, on_way, drawn["part_open"])
    T_wo = scene.T_wo(drawn)
    goals = handle_in_world(
        scene.asset,
        scene.task.joint,
        T_wo=T_wo,
        scale=drawn["scale"],
        opened=opened,
        flip=scene.place.flip,
    )
    empty = ~grip & (rng.random(n) < config.empty_share)
    back = np.where(grip, 0.0, config.standoff_m * rng.random(n) ** 2)
    back = np.where(empty, np.maximum(back, config.empty_m), back)
    astray = ~grip & (rng.random(n) < config.astray_share)
    nearest, aside = config.astray_m
    back = np.where(astray, nearest + (config.standoff_m - nearest) * rng.random(n), back)
    sides = np.where(astray, aside, 0.0) * rng.uniform(-1.0, 1.0, (2, n))
    closing = ~(grip | empty | astray) & (rng.random(n) < config.closing_share)
    back = np.where(closing, 0.0, back)
    goals = goals @ pose(np.stack([*sides, -back], axis=1))
    found = solve_ik(scene.arm, goals, np.asarray(scene.place.start_q), iterations=80)
    handle = scene.asset.handle_of(scene.task.joint)
    thick = handle.extent[1] if handle is not None else 0.02
    held = np.clip(thick * drawn["scale"], 0.0, scene.arm.hand.max_width_m)
    ok = found.reached
    if not ok.any():
        ok[:] = True
    return Start(
        draw=Draw(drawn.values[ok]),
        q=found.q[ok],
        opened=opened[ok],
        width=np.select([grip, empty], [held, 0.0 * held], scene.arm.hand.max_width_m)[ok],
        closing=np.where(grip | empty | closing, 1.0, -1.0)[ok],
        home=np.zeros(int(ok.sum()), dtype=bool),
    )


PLACED = ("scale", "x_m", "y_m", "yaw_rad", "part_open")
"""Drawn numbers on which a prepared arm pose depends."""


def mixed_start(
    scene: Scene, bank: Start, drawn: Draw, share: float, rng: np.random.Generator
) -> Start:
    """Home starts, of which ``share`` are replaced by rows of ``bank``."""
    home = home_start(scene, drawn)
    n = len(drawn.values)
    along = rng.random(n) < share
    pick = rng.integers(len(bank.q), size=n)
    values = drawn.values.copy()
    columns = np.array([COLUMNS.index(name) for name in PLACED])
    values[np.ix_(along, columns)] = bank.draw.values[pick[along]][:, columns]

    def choose(a: Array, b: Array) -> Array:
        mask = along if a.ndim == 1 else along[:, None]
        return np.where(mask, b[pick], a)

    return Start(
        draw=Draw(values),
        q=choose(home.q, bank.q),
        opened=choose(home.opened, bank.opened),
        width=choose(home.width, bank.width),
        closing=choose(home.closing, bank.closing),
        home=~along,
    )
