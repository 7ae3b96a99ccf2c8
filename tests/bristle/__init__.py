"""A second generator of measured campaigns: finite elements and bristles. Imports nothing judged."""

from tests.bristle.causes import CAUSES
from tests.bristle.machine import PAIR_CAUSES, PAIR_PLANS
from tests.bristle.make import MECHANISMS, SEEDS, Truth, make_campaign
from tests.bristle.writing import PLANS

__all__ = ["CAUSES", "MECHANISMS", "PAIR_CAUSES", "PAIR_PLANS", "PLANS", "SEEDS", "Truth", "make_campaign"]
