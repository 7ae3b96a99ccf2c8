"""Tension and elongation of the tendon on a route: geometry in, transmission out."""
