"""Everything that knows a format, a unit or a socket: files to frames, results to files."""
