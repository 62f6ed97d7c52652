"""A policy bundle on a robot."""
