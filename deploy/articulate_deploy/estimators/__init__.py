"""Where the object's state comes from."""
