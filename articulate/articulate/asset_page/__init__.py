"""HTML pages of checked assets, with a 3-D view."""
