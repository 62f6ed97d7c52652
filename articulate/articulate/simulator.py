"""MuJoCo, as everything here imports it.

Left to itself it writes its warnings to standard output and into ``MUJOCO_LOG.TXT`` in whatever
folder a person stands in. Here they go to a logger instead; what matters of them is found by
measuring (a state that diverges, a mass that is none).
"""

from __future__ import annotations

import logging

import mujoco  # noqa: TID251  # the one place

__all__ = ["mujoco"]

mujoco.set_mju_user_warning(logging.getLogger(__name__).info)
