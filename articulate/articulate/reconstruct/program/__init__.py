"""Language of programs: a small part of Python that places parts and joins them.

Nothing is imported here: the child process that runs programs imports this package and needs only
the standard library.
"""
