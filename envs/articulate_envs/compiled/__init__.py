"""Compiled loop of the engine: row functions (:mod:`articulate.jit`) compiled by numba into one loop.

Python would serialise the threads between two control steps, so each part of a control step is one
compiled call: ``pre_step``, ``step``, ``post_step``.
"""
