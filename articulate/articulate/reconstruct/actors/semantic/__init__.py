"""Joints from what parts are called, from their shapes and from what is in their way."""
