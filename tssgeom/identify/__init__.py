"""Measured against simulated: where they disagree, which physical effect is missing, and what it mends."""
