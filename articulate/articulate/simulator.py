"""MuJoCo with its warnings sent to a logger.

By default MuJoCo prints warnings and appends them to ``MUJOCO_LOG.TXT`` in the current folder.
Problems that matter are detected by measurement (a diverging state, a missing mass).
"""

from __future__ import annotations

import logging

import mujoco  # noqa: TID251  # the only import

__all__ = ["mujoco"]

mujoco.set_mju_user_warning(logging.getLogger(__name__).info)
