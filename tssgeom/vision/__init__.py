"""Markers along a sheath in the images of calibrated cameras: images to ordered points with covariance."""
