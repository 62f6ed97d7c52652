"""File formats: read URDF, MJCF and mesh files from untrusted sources."""
