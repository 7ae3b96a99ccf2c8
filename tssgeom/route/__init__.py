"""Sensed points to geometry: route, curvature, accumulated angle, pieces. Knows no tendon."""
