"""Measured campaigns with a known cause, for the workflow that identifies it.

The physics and the instruments are those of `tests.lumped`; nothing here imports `tssgeom`, and the files are
plain text. The cause lies in a file beside the campaign's folder, never in it.

    truth = make_campaign(Path("a"), seed=3, effect="creep")       # writes a/ and a.truth.json
    make_campaign(Path("b"), seed=3, effect=("creep", "backlash"), size=0.5, split="test")

A campaign of the full plan has five runs of about 300 samples on three routes of one sheath, the last route
held out: position driven, several peak tensions, two speeds ten times apart, dwells, another base tension, no
slack. The rig file is nominal: the true friction and compliance are a few per cent off.
"""

from tests.campaigns.causes import INSIDE, OUTSIDE, PAIRS
from tests.campaigns.make import PLANS, SEEDS, Truth, make_campaign, signature

__all__ = ["INSIDE", "OUTSIDE", "PAIRS", "PLANS", "SEEDS", "Truth", "make_campaign", "signature"]
