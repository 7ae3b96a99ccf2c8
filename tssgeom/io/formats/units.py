"""Units of length at the boundary: everything inside tssgeom is in metres."""

from pathlib import Path

from tssgeom.errors import ShapeError

PER_METRE = {"m": 1.0, "mm": 1000.0}
"""How many of each unit make one metre; dividing by it converts exactly rounded."""


def agreed_unit(path: Path, found: str | None, given: str | None, remedy: str) -> str:
    """Return the one unit of a file: what it states itself, or what `--unit` says.

    Parameters
    ----------
    path
        The file, for the message.
    found
        The unit that the file states, if any.
    given
        The unit that the user states, if any.
    remedy
        How this format states a unit, such as "name the columns x_mm,y_mm,z_mm".

    Raises
    ------
    ShapeError
        Where no unit is stated, where it is neither m nor mm, or where file and user disagree.
    """
    unit = found or given
    if unit is None:
        raise ShapeError(f"{path}: the coordinates have no unit: {remedy}, or give --unit mm|m")
    for stated in (found, given):
        if stated is not None and stated not in PER_METRE:
            raise ShapeError(f"{path}: the unit is {stated!r}: write mm or m")
    if found and given and found != given:
        raise ShapeError(f"{path}: the file is in {found}, --unit says {given}: leave --unit out")
    return unit


def given_unit(path: Path, given: str | None, why: str) -> str:
    """Return the unit that the user states for a format that has no place for one.

    Parameters
    ----------
    path
        The file, for the message.
    given
        The unit that the user states, if any.
    why
        What has no place for a unit, such as "a ROS bag".

    Raises
    ------
    ShapeError
        Where the user states none, or one that is neither m nor mm.
    """
    if given is None:
        raise ShapeError(f"{path}: {why} states no unit of length: give --unit mm|m")
    return agreed_unit(path, None, given, "")
