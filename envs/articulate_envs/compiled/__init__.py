"""What runs at every tick, compiled: it repeats for one environment what robots run in Python.

Between two ticks of the physics nothing else goes on, and Python would hold all threads up.

numba keeps compiled code by the file of the outermost function: who changes something that another
module here calls saves that module again as well, or clears ``__pycache__``.
"""
