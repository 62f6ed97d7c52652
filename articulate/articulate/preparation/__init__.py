"""Preparation: convert, repair, check and cache an asset."""
