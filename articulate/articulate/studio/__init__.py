"""Local page in which a person views and corrects a reconstructed object."""
