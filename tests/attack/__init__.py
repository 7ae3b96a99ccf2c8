"""Attacks from outside: hostile files, names and peers; each driver counts what may not happen."""
