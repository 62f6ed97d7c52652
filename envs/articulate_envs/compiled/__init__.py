"""Compiled loop of the engine: numba compiles the row functions of :mod:`articulate.jit`.

Python would serialise the threads between two control steps, so each part of a control step is one
compiled call: ``pre_step``, ``step``, ``post_step``.
"""
