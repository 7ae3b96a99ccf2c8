"""Sensed points to a smooth curve: a quintic smoothing spline, its smoothness by marginal likelihood."""
