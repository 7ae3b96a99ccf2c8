"""A second generator of measured campaigns: finite elements with bristles that stick. Imports nothing judged."""

from tests.bristle.causes import CAUSES
from tests.bristle.make import MECHANISMS, PLANS, SEEDS, Truth, make_campaign

__all__ = ["CAUSES", "MECHANISMS", "PLANS", "SEEDS", "Truth", "make_campaign"]
