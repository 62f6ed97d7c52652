"""Objects made from numbers: the same numbers give the same bytes."""
