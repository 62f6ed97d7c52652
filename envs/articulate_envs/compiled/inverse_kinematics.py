"""Compiled inverse kinematics for the batches of placement search and initial states."""

from __future__ import annotations

from functools import partial

from articulate.robot import kinematics
from articulate_envs.compiled.entry_points import entry_point

solve_ik = partial(kinematics.solve_ik, rows=entry_point(kinematics.write_ik))
"""See :func:`articulate.robot.kinematics.solve_ik`."""
