"""Proportions, front and parts of an object in one image of an unknown camera."""
