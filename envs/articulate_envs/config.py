"""Configuration of rewards and initial states, without arrays: `--help` does not load numpy."""

from __future__ import annotations

from dataclasses import dataclass

from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class RewardConfig:
    """Weights of the reward terms; the reward of a control step is their sum."""

    approach: float = 100.0
    """Weight of each metre by which the tool comes nearer to the handle in a control step: a
    potential, so that a gain is lost again on the way back (Ng, Harada and Russell 1999)."""
    approach_across: float = 2.0
    """Factor on distances across the fingers in ``approach``: they straddle the handle first."""
    approach_turn_m: float = 0.1
    """Distance that equals a radian between gripper and handle in ``approach`` [m/rad]."""
    reach: float = 0.8
    """Weight of the tool at the handle: the mean of 1 / (1 + (d / scale)^2) over two scales."""
    reach_m: tuple[float, float] = (0.08, 0.015)
    """Scales of ``reach`` [m]: one attracts the gripper from afar, the other onto the handle."""
    align: float = 0.4
    """Weight of the orientation of the gripper at the handle, scaled by closeness."""
    align_rad: float = 0.35
    """Angle at which ``align`` falls to 1/e [rad]."""
    grip: float = 0.5
    """Weight of a close command and of a closed gripper at the handle; 0 for a gripper that has
    closed on nothing, which has to open again."""
    grip_m: float = 0.018
    """Distance at which ``grip`` falls to 1/e, at the beginning of training [m]."""
    grip_last_m: float = 0.010
    """The same at the end of training, linear between. A handle that is grasped off its middle
    slips out while it is pulled, and a narrow optimum is found only from near it."""
    premature_close: float = -0.25
    """Weight of a close command and of a closed gripper away from the handle at the beginning of
    training, and anywhere for a gripper that has closed on nothing. The command counts from -1 on,
    not from 0: otherwise nothing moves a policy away from the middle, where the noise of training
    opens and closes the gripper and the deployed mean action does neither."""
    premature_close_last: float = -0.75
    """The same at the end of training, linear between. If it is large at first, closing is given up
    before its use is learned. The distance that counts as away narrows as ``grip_m`` does."""
    lateral_offset: float = -150.0
    """Weight of each metre by which the handle is outside the corridor between the fingers, or the
    gripper beyond a handle that it does not hold, at the end of training; proportionally less
    before. ``approach`` rewards all paths equally; this term selects the one that first moves
    across and then ahead, so that no finger comes down on the handle. With the handle between the
    fingers it applies from half way there on until both can touch it: a gripper that closes on a
    knob from one side pushes it out."""
    lateral_free_share: float = 0.45
    """Half width of the corridor at the handle, as a share of the room between the fingers."""
    lateral_free_from_m: float = 0.07
    """Distance before the handle from which the corridor widens, as fast as the distance grows
    [m]."""
    lateral_offset_max_m: float = 0.02
    """Largest offset that counts [m]: without it an episode that begins 12 cm beside the handle of
    a lid lost 280, five times the reward of success."""
    overreach_m: float = 0.003
    """Free distance of the gripper beyond the handle [m]: where there is room, the tips have 5 mm
    there, and a gripper that uses them up presses on the surface behind. A gripper that holds the
    handle cannot change it any more and is not penalized."""
    open: float = 0.6
    """Weight of the fraction of the path to the target. A larger weight of time makes policies
    close the gripper on the way and pull before it has closed."""
    margin: float = 0.12
    """Share beyond the target up to which the path is rewarded, at most half the room to the stop:
    the estimate of the part is noisy, and a policy that aims at the target stops short of it."""
    overshoot: float = 0.5
    """Share of that reward that is lost again from there to the stop of the part, which jerks the
    gripper."""
    overshoot_room: float = 0.1
    """Least share of the range over which ``overshoot`` applies. Where the stop is nearer to the
    target, as in closing, reaching it costs proportionally less."""
    progress: float = 60.0
    """Weight of each change of that fraction."""
    rest: float = 0.6
    """Weight of being at rest beyond the target: 0 at the target, 1 at the end of the margin. If
    rest at the target itself is rewarded, the mean action stops there and ends at 0.79."""
    force: float = -0.02
    """Weight of each newton of filtered force beyond ``force_free_n``, at the beginning of
    training."""
    force_last: float = -0.16
    """The same at the end, linear between; a large weight at first keeps the gripper off the
    handle."""
    force_free_n: float = 15.0
    """Force without penalty [N]."""
    speed: float = -2.0
    """Weight of the speed of the part beyond ``speed_free``, per m/s or 0.2 rad/s."""
    speed_free: float = 0.15
    """Speed of the part without penalty [m/s]."""
    action: float = -0.01
    """Weight of the mean square of the motion."""
    violation: float = -40.0
    """Reward of the first violated limit of an episode, at the end of training; proportionally less
    before. With half of it a policy pushed too hard on a closed door in one of six episodes."""
    violated_share: float = 0.3
    """Share of the rewards of opening after a violation, at the end of training; 1 at the
    beginning, linear between, as otherwise too little is learned of opening."""
    success: float = 60.0
    """Reward at the end of a successful episode. All other terms count every control step, and a
    part that creeps back in the last second loses almost nothing of them."""
    until: float = 0.6
    """Share of the training after which the weights have their last values."""

    def __post_init__(self) -> None:
        check_until("reward", self.until)


def check_until(name: str, until: float) -> None:
    """Check a share of a training.

    Raises:
        ConfigError: ``until`` is not in (0, 1].
    """
    if not 0.0 < until <= 1.0:
        raise ConfigError(f"{name}.until is {until}; it must be above 0 and at most 1")


@dataclass(frozen=True, kw_only=True)
class InitialStatesConfig:
    """Initial states of training episodes along the task, and their truncation."""

    share_first: float = 0.8
    """Share of starts along the task at the beginning of training, in [0, 1]."""
    share_last: float = 0.2
    """Share at the end of the curriculum, in [0, 1]."""
    until: float = 0.6
    """Share of the training after which ``share_last`` applies, linear between."""
    grip_share: float = 0.45
    """Share of these starts with the gripper closed on the handle of a partly moved part."""
    standoff_m: float = 0.12
    """Largest distance before the handle of the other starts [m]; their part is not moved yet."""
    empty_grasp_share: float = 0.3
    """Share of starts before the handle with a gripper that has closed on nothing, which learns to
    open again."""
    empty_grasp_m: float = 0.016
    """Least distance of such a gripper before the handle [m]."""
    closing_share: float = 0.4
    """Share of starts before the handle that are at it, with an open gripper and a new close
    command: the result of closing there is seen before the policy has learned to close."""
    off_target_share: float = 0.15
    """Share of starts before the handle with a lateral offset, which learn not to push a finger
    against its front."""
    off_target_m: tuple[float, float] = (0.04, 0.06)
    """Least distance before the handle and largest lateral offset of such a gripper [m]."""
    n_precomputed: int = 512
    """Number of precomputed initial states."""
    truncation_probability: float = 0.04
    """Probability in each control step that an episode of training is truncated after its part has
    been at rest at the target for the hold time. The time is spent on the next episode; otherwise
    most control steps would have a part at rest."""
    truncation_env_share: float = 0.5
    """Share of the environments with such truncations, in [0, 1). In the others the part is held to
    the end, which has to be learned too; the success of training counts these."""

    def __post_init__(self) -> None:
        check_until("initial_states", self.until)
        if not 0.0 <= self.truncation_env_share < 1.0:
            raise ConfigError(
                f"initial_states.truncation_env_share is {self.truncation_env_share}; it must be "
                "at least 0 and below 1"
            )

    def share(self, progress: float) -> float:
        """Return the share of starts along the task at ``progress`` in [0, 1] of the training."""
        done = min(max(progress / self.until, 0.0), 1.0)
        return self.share_first + done * (self.share_last - self.share_first)
