"""Clips: reading them, following points through them, and what moves in them."""
