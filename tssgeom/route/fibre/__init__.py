"""Curvatures that a fibre senses at its gratings, and the route that follows from them."""
