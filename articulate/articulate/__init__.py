"""What an object is: make it, read it, prove it."""
