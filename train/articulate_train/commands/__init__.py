"""Commands: parse flags, call one function, render its result."""
