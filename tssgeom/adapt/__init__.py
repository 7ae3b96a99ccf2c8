"""A rig that is followed while it runs: numbers that drift, faults that are beyond chance."""
