"""Rigs that are followed, against the independent simulator."""
