"""Reconstruct articulated objects from a video, an image or a text, and parts."""
