"""The language that actors write: a small part of Python that places parts and joins them.

Nothing is imported here: the child process that runs programs imports this package with the
standard library alone.
"""
