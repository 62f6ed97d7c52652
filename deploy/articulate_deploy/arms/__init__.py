"""Real arms: set points at 1 kHz, clients of controllers, each in a child process."""
