"""A finding as a recording."""
