"""Slower execution: a manifest whose clock runs at a share of the trained speed."""

from __future__ import annotations

from dataclasses import replace

from articulate.errors import ConfigError
from articulate.task.manifest import Manifest

MIN_SCALE = 0.05
"""Smallest speed of the policy's clock."""


def check_speed_scale(speed_scale: float) -> None:
    """Check a speed of the policy's clock.

    Raises:
        ConfigError: It is outside [0.05, 1].
    """
    if not MIN_SCALE <= speed_scale <= 1.0:
        raise ConfigError(f"--speed-scale is {speed_scale}; it must be in [{MIN_SCALE}, 1]")


def scaled_manifest(manifest: Manifest, speed_scale: float) -> Manifest:
    """Return ``manifest`` with control steps longer by ``1 / speed_scale``.

    The set-point filter has its bandwidth scaled, so the arm follows the path of the trained speed,
    later; an episode keeps its number of control steps. Fingers are slower and commands to the
    gripper are further apart. Changes of targets per control step stay the same. The object is not
    scaled: friction and weight act as before.
    """
    if speed_scale == 1.0:
        return manifest
    control, gripper = manifest.control, manifest.robot.gripper
    slow = replace(
        gripper,
        finger_speed_m_s=gripper.finger_speed_m_s * speed_scale,
        smoothing=gripper.smoothing**speed_scale,
        dwell_s=gripper.dwell_s / speed_scale,
    )
    return replace(
        manifest,
        control=replace(
            control,
            rate_hz=control.rate_hz * speed_scale,
            omega_rad_s=control.omega_rad_s * speed_scale,
        ),
        robot=replace(manifest.robot, gripper=slow),
    )
