"""Articulated objects: reconstruct, read, convert and check them."""
