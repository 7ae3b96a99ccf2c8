"""Files to frames, runs, rigs and campaigns: one module for each format."""
