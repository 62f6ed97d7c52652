"""Tasks: part kinds, success criteria, observations, actions and randomization."""
