"""Recordings for the viewer rerun: joints, targets, force and opening over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from articulate.errors import MissingError, UsageError
from articulate.files import atomic_write
from articulate_deploy.recorded_episodes import RecordedDeployment

SCALARS = (
    "joint_pos", "target", "joint_vel", "measured_force_n", "gripper_width_m", "estimate_open",
    "part_open", "policy_s",
)  # fmt: skip
"""Arrays that are written, each number as one curve."""


def write_rerun(deployment: RecordedDeployment, out: Path) -> Path:
    """Write all episodes to one ``.rrd`` file, one timeline an episode.

    Raises:
        MissingError: rerun-sdk is not installed.
        UsageError: ``out`` does not end in .rrd.
    """
    if out.suffix != ".rrd":
        raise UsageError(f"--out {out}: must end in .rrd")
    try:
        import rerun  # heavy; imported on demand
    except ImportError:
        raise MissingError(
            f"{out}: .rrd needs rerun-sdk, which is not installed; "
            'run: pip install "articulate-robots[watch]"'
        ) from None
    with atomic_write(out) as temporary:
        stream = rerun.RecordingStream("articulate", send_properties=False)
        stream.save(temporary)
        for episode in deployment.episodes:
            times = episode.arrays["time_s"]
            for name in SCALARS:
                if name not in episode.arrays:
                    continue
                values = episode.arrays[name].reshape(len(times), -1)
                for k, column in enumerate(np.asarray(values).T):
                    stream.send_columns(
                        f"episode_{episode.index:04d}/{name}/{k + 1}",
                        indexes=[rerun.TimeColumn("time", duration=times)],
                        columns=rerun.Scalars.columns(scalars=column),
                    )
        stream.flush()
        stream.disconnect()
    return out
