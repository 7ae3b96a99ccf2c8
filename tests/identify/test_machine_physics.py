"""What physics refuses of a machine, and what it has no right to refuse."""

import re
from itertools import pairwise

import numpy as np

from tests.campaigns.make import make_campaign
from tssgeom.identify.machine_discovery import discover_machine
from tssgeom.identify.machine_physics import closed_cycles
from tssgeom.io.formats.machine_campaigns import read_machine_campaign


def spring(turned: list[float]) -> tuple[list[np.ndarray], np.ndarray]:
    """Tension and displacement of what gives as much as it takes, and its turns."""
    way = np.concatenate([np.linspace(a, b, 10, endpoint=False) for a, b in pairwise(turned)])
    return [100.0 * way, way], np.arange(10, len(way), 10)


def test_peaks_of_unlike_height_close_no_cycle():
    assert closed_cycles(*spring([0.0, 1.0, 0.2, 0.6, 0.4, 0.9, 0.0])) == slice(0)


def test_the_longest_cycles_that_close_are_taken():
    assert closed_cycles(*spring([0.0, 1.0, 0.0, 1.0, 0.5, 0.98, 0.0])) == slice(10, 51)


def test_play_of_a_drive_is_not_refused_for_peaks_of_unlike_height(tmp_path):
    """No run measures a force; what the tendon stores between unlike peaks is no work of the sheath."""
    truth = make_campaign(tmp_path, 1, "backlash", plan="displacement_only")
    file = tmp_path / "campaign.toml"
    *others, fourth, last = re.split(r"(?=\[\[run\]\])", file.read_text(encoding="utf-8"))
    swapped = fourth.replace("held_out = false", "held_out = true"), last.replace("true", "false")
    file.write_text("".join((*others, *swapped)), encoding="utf-8")  # the last alone has long strokes
    finding = discover_machine(read_machine_campaign(tmp_path))
    (backlash,) = finding.effects
    assert backlash.names == ("backlash",)
    width = backlash.parameters[0]["width_m"]
    assert width.low < truth.parameters["backlash"]["width_m"] < width.high
