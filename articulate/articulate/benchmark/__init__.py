"""The benchmark: how often an actor finds what is true of objects whose joints are known."""
