"""Policies: train, evaluate, export."""
