"""Render parts and MuJoCo models without a display; encode images and videos."""
