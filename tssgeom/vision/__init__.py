"""Markers along a sheath, seen by calibrated cameras: images to ordered points with covariance."""
