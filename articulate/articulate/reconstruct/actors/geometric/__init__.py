"""Actors and critics that need geometry and no network."""
