"""A segment of which friction is a third too low in the rig follows its targets once the rig is followed."""

import numpy as np
from msgspec.structs import replace as changed

from tests.test_machine_stream import POINTS
from tssgeom import Engine, Frame
from tssgeom.adapt.follower import Follower
from tssgeom.mechanism import Drive, End
from tssgeom.rig import Friction, Rig, Sensor, Tendon
from tssgeom.sensed_route import fit_frame
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_simulation import begun, simulated

NOISE = 2e-3  # rad
DRIVES = tuple(f"displacement_in_{k}_m" for k in (1, 2, 3))
BENDING = ("bending_x_rad", "bending_y_rad")
TRUE = Rig(
    tendon=Tendon(pretension_N=8.0),
    friction=Friction(coefficient=0.16),
    drive=Drive(kind="tendons"),
    end=End(kind="segment", radius_m=4e-3, stiffness_Nm_per_rad=0.05, tendon_angles_deg=(0.0, 120.0, 240.0)),
    sensors={name: Sensor(noise=NOISE) for name in BENDING},
)


def rms_miss(engine, rng):
    """Return how far the segment is from its targets over the last ten of twenty seconds [rad]."""
    plant = machine_of(TRUE, [routed(fit_frame(Frame(POINTS, 0.0), TRUE)[1].fit.arcs, TRUE)])
    stands = begun(plant, "displacement_in", np.zeros(1))
    moved, miss, wanted = dict.fromkeys(DRIVES, 0.0), [], np.zeros(2)
    for time in np.arange(0.05, 20.0, 0.05).tolist():
        run = {"time_s": np.array([time])} | {name: np.array([value]) for name, value in moved.items()}
        done = simulated(plant, run, before=stands)
        stands, bent = done.history, np.array([done.channels[name][0] for name in BENDING])
        miss.append(bent - wanted)
        wanted = 0.6 * min(time / 2.0, 1.0) * np.array([np.cos(time), np.sin(time)])
        read = dict(zip(BENDING, bent + NOISE * rng.standard_normal(2), strict=True))
        asked = {
            name.replace("_rad", "_target_rad"): value for name, value in zip(BENDING, wanted, strict=True)
        }
        points = POINTS + 5e-5 * rng.standard_normal(POINTS.shape)
        result = engine.push(Frame(points, time, of_machine=moved | read | asked))
        moved = dict(result.machine.command.inputs)
    assert result.alert is None
    return float(np.sqrt(np.mean(np.square(miss[-200:]))))


def test_commands_of_a_followed_segment_miss_a_fifth_of_what_those_of_its_rig_miss():
    rig = changed(TRUE, friction=Friction(coefficient=0.12))
    plain = rms_miss(Engine(rig, tension_in=8.0), np.random.default_rng(1))
    followed = rms_miss(Engine(rig, tension_in=8.0, follower=Follower(rig)), np.random.default_rng(1))
    assert followed < 0.2 * plain
    assert followed < NOISE
