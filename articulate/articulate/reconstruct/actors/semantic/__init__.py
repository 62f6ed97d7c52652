"""Predict joints from the names and shapes of parts."""
