"""Read videos, track points and observe joint motion."""
