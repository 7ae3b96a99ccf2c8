"""A chain of circular arcs fitted to points by maximum likelihood, with joints where the points want them."""
