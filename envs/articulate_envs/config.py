"""What can be set of the reward and of the starts of episodes, apart from what computes with it.

Nothing here holds an array: see :mod:`articulate.task.randomization_config`.
"""

from __future__ import annotations

from dataclasses import dataclass

from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class RewardConfig:
    """Weights. A tick's reward is the sum of the terms."""

    approach: float = 100.0
    """For each metre that the tool comes nearer to the handle in one tick: a potential, what is
    gained on the way is lost on the way back (Ng, Harada and Russell 1999)."""
    approach_across: float = 2.0
    """How much more a metre across the fingers counts in it: they straddle the handle first."""
    approach_turn_m: float = 0.1
    """What a radian between hand and handle counts in it [m/rad]."""
    reach: float = 0.8
    """For the tool being at the handle: the mean of 1 / (1 + (d / scale)^2) over two scales."""
    reach_m: tuple[float, float] = (0.08, 0.015)
    """Those scales [m]: one draws the hand near, the other onto the handle."""
    align: float = 0.4
    """For the hand being turned like the handle, weighted by closeness."""
    align_rad: float = 0.35
    """Angle at which that has fallen to 1/e [rad]."""
    grip: float = 0.5
    """For a hand that is told to close, and for one that is closed, at the handle; not for one
    that has closed on nothing, which has to open again."""
    grip_m: float = 0.018
    """Distance at which that has fallen to 1/e, at the beginning of training [m]."""
    grip_last_m: float = 0.010
    """The same at its end; linear between. What is held off its middle slips out while it is
    pulled, and a narrow place is found only from near it."""
    premature_close: float = -0.25
    """For a hand that is told to close, or is closed, away from the handle, at the beginning; for
    one that has closed on nothing wherever it is, as it has to open again. The command counts from
    -1 on, not from 0: nothing else would move a policy away from the middle, where the noise of
    training opens and closes the hand and the mean action that is deployed does neither."""
    premature_close_last: float = -0.75
    """The same at the end of training; linear between (dear at first, closing is given up before
    it has been learnt what it is good for). What counts as away narrows as ``grip_m`` does."""
    lateral_offset: float = -150.0
    """For each metre by which the handle lies beside the way between the fingers, or the hand
    beyond a handle that it does not hold, at the end of training; in proportion before.
    ``approach`` pays the same for every path; this is what bends it: across first, then ahead, so
    that no finger comes down on the handle. What fingers may already have between them costs it
    from half way there on, until both can touch it: one that closes on a knob from one side pushes
    it out of the hand."""
    lateral_free_share: float = 0.45
    """Half as wide is that way at the handle, as a share of the room between the fingers."""
    lateral_free_from_m: float = 0.07
    """So far before the handle it begins to widen, as fast as the distance grows [m]."""
    lateral_offset_max_m: float = 0.02
    """What lies farther beside costs as this much [m]: an episode that begins 12 cm beside the
    handle of a lid lost 280 by it, ten times what its success is worth."""
    overreach_m: float = 0.003
    """So far beyond the handle the hand may be [m]: tips have 5 mm there, where there is as much
    room, and a hand that may use them up presses on what stands behind. One that holds the handle
    cannot change it any more, and would pay for it to the end of the episode."""
    open: float = 0.6
    """For the fraction of the way to the target. Dearer time makes a policy impatient: it closes
    the hand on the way and pulls before it has closed."""
    margin: float = 0.12
    """The way is paid for up to the target and this share of it beyond, at most half the room to
    the stop: what is known of the part is noisy, and one who aims at the target itself stops
    short of it."""
    overshoot: float = 0.5
    """Share of it that is lost again from there to the part's stop, which jerks the hand."""
    overshoot_room: float = 0.1
    """Least share of the range on which that is lost: where the stop is nearer to the target (a
    part that is to be closed), meeting it costs in proportion less."""
    progress: float = 60.0
    """For each change of that fraction."""
    rest: float = 0.6
    """For resting beyond the target: nothing at it, all of it at the end of the margin. Paid for
    resting at the target itself, a policy's mean action rests there, and is found at 0.79."""
    force: float = -0.02
    """For each newton of filtered force beyond ``force_free_n``, at the beginning of training."""
    force_last: float = -0.16
    """The same at its end; linear between (dear forces at first keep the hand off the handle)."""
    force_free_n: float = 15.0
    """Force that costs nothing [N]."""
    speed: float = -2.0
    """For the part's speed beyond ``speed_free``, per m/s or 0.2 rad/s."""
    speed_free: float = 0.15
    """Speed of the part that costs nothing [m/s]."""
    action: float = -0.01
    """For the mean square of the motion."""
    violation: float = -40.0
    """Once, when a limit of the task is broken, at the end of training; in proportion before. At
    half of it a policy pushed on a door that was shut, too hard in one of six episodes."""
    violated_share: float = 0.3
    """Share of what opening earns that is left after a violation, at the end of training; all of
    it at the beginning, linear between (else too little is learnt of opening)."""
    success: float = 60.0
    """Once, at the end of an episode that is a success. All else pays by the tick, and a part that
    creeps back in the last second loses next to nothing by that."""
    until: float = 0.6
    """Share of the training after which weights are as at its end."""

    def __post_init__(self) -> None:
        check_until("reward", self.until)


def check_until(name: str, until: float) -> None:
    """Refuse what is no share of a training.

    Raises:
        ConfigError: ``until`` is not in (0, 1].
    """
    if not 0.0 < until <= 1.0:
        raise ConfigError(f"{name}.until is {until}; it must be above 0 and at most 1")


@dataclass(frozen=True, kw_only=True)
class InitialStatesConfig:
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
    empty_grasp_share: float = 0.3
    """Of those before the handle, the share with a hand that has closed on nothing, which learns
    to open again."""
    empty_grasp_m: float = 0.016
    """How far before the handle such a hand is at least [m]."""
    closing_share: float = 0.4
    """Of those before the handle, the share that is at it with an open hand that has just been
    told to close: what closing there leads to is met before the policy has learnt to want it."""
    off_target_share: float = 0.15
    """Of those before the handle, the share that lies to one side of it, which learns not to push
    a finger against its front."""
    off_target_m: tuple[float, float] = (0.04, 0.06)
    """How far before the handle such a hand is at least, and to either side at most [m]."""
    n_precomputed: int = 512
    """How many such starts are prepared."""
    truncation_probability: float = 0.04
    """Chance, each tick, that an episode of training ends once its part has rested at the target
    as long as success asks for. Such an end counts as cut off (a truncation), and the time is
    spent on the next episode: else most of all ticks would show a part at rest."""
    truncation_env_share: float = 0.5
    """Share of the environments in which episodes are cut, in [0, 1). In the others the part is
    held to the end, which has to be learnt too; what training says of successes is of these."""

    def __post_init__(self) -> None:
        check_until("initial_states", self.until)
        if not 0.0 <= self.truncation_env_share < 1.0:
            raise ConfigError(
                f"initial_states.truncation_env_share is {self.truncation_env_share}; it must be at least 0 and below 1"
            )

    def share(self, progress: float) -> float:
        """Share of starts along the task when ``progress`` in [0, 1] of the training is done."""
        done = min(max(progress / self.until, 0.0), 1.0)
        return self.share_first + done * (self.share_last - self.share_first)
