"""Recordings for the Rerun viewer."""

from tssgeom.address_space import FIRST, require_address_space

require_address_space(FIRST, "a recording", ", or write no recordings")
