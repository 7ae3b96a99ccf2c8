"""Frames and results over standard streams, TCP, UDP and OpenIGTLink, in one thread on one selector."""
