"""The public calls that take paths as well as arrays, and what notebooks show of their results."""
