"""Scenes and engines."""
