"""A chain of circular arcs fitted to points by maximum likelihood, with as many joints as BIC supports."""
