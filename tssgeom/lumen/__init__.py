"""The lumen around a route: its wall, and the clearance between both."""
