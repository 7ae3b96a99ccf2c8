"""Errors of tssgeom: each message says what is wrong, the value with its unit, and the remedy."""


class TssgeomError(Exception):
    """Root of every error that tssgeom raises on purpose."""


class ShapeError(TssgeomError, ValueError):
    """A sensed shape that cannot be used, such as too few points or no unit."""


class SettingsError(TssgeomError, ValueError):
    """A rig or an option outside its bounds, or an unknown key."""


class FitError(TssgeomError):
    """A fit that did not converge on valid input."""


class SourceError(TssgeomError):
    """A file or stream that cannot be read or written."""
