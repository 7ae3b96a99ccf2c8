"""Recordings for the Rerun viewer."""

from tssgeom.view.scene.address_space import FIRST, require_address_space

require_address_space(FIRST)
