"""Geometry: collision shapes, inertia, handles and convex decomposition."""
