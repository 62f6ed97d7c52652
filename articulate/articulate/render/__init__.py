"""Pictures without a screen: where a camera stands, and what it sees of parts or a model."""
