"""Estimators of the object's state."""
