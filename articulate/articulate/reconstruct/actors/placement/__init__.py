"""Where parts belong, found from a picture by drawing them and comparing."""
