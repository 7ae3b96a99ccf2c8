"""Formats, units and sockets: files to frames, results to files."""
