"""Facts that a chain has to meet, whatever its numbers, and how fine it has to be."""

import dataclasses

import numpy as np
import pytest

from tests.bristle import laws
from tests.bristle import rig as rigs
from tests.bristle.chain import Bristles, Build, Chain, Numerics, Table, linear, spring
from tests.bristle.laws import Acts
from tests.bristle.machine import Pair, run_pair
from tests.bristle.rig import Rig, run
from tests.bristle.sheath import random_sheath, sheath_of
from tests.bristle.waves import KINDS, course

HALF_CIRCLE = sheath_of(np.tile([2.0 * np.pi, 0.0], (1601, 1)), 0.5)
CHANNELS = ("tension_in", "tension_out", "displacement_out")


def sheath(kind, total_angle=4.0):
    return random_sheath(np.random.default_rng(kind), 0.55, total_angle, kind)


def rig(route, **more):
    return Rig(0.16, 3e-4, 3.5, 800.0, [route], **more)


def followed(rig, kind, **acts):
    """Follow one course of the drive; return times, drive and courses."""
    route, n = rig.sheaths[0], 300
    low = rig.reach(route, 1.7 * np.exp(rig.friction * route.total_angle), pulled=False)
    high = rig.reach(route, 9.0, pulled=True)
    start = rig.pretension if rig.drive == "force" else 0.0
    wave = low + (high - low) * course(KINDS[kind], np.random.default_rng(3), n - 36)
    drive = np.concatenate([np.full(18, start), np.linspace(start, low, 19)[1:], wave])
    time = np.arange(1, n + 1) / 50.0
    return time, drive, run(rig, route, time, drive, Acts(**acts))


def held_at(chain, tension, parts=60):
    for value in np.linspace(chain.tension_in, tension, parts + 1)[1:]:
        chain.advance(float(value), 0.05)


def chain_of(route, drive="force", **more):
    numbers = {"friction": 0.145, "strain": linear(3.16e-4), "pretension": 3.0, "load": spring(3.0, 1000.0)}
    return Chain(Build(sheaths=[route], drive=drive, **numbers | more))


def assert_near(changed, usual, most):
    """Hold the largest change [N, N, m] of each channel, which is at turns, and a quarter of it as rms."""
    for name, bound in zip(CHANNELS, most, strict=True):
        difference = changed[name] - usual[name]
        assert np.max(np.abs(difference)) < bound
        assert np.sqrt(np.mean(difference**2)) < bound / 4.0


@pytest.mark.parametrize("kind", [0, 1, 2])
@pytest.mark.parametrize("angle", [1.8, 4.6])
def test_a_tendon_that_slides_all_along_has_the_ratio_of_the_capstan(kind, angle):
    chain = chain_of(sheath(kind, angle))
    held_at(chain, 16.0)
    assert chain.load_force / chain.tension_in == pytest.approx(np.exp(-0.145 * angle), rel=1e-4)
    held_at(chain, 1.5)
    assert chain.load_force / chain.tension_in == pytest.approx(np.exp(0.145 * angle), rel=1e-4)


def test_the_half_circle_of_the_paper_has_its_elongations():
    # Section III-B, Fig. 5: 15 N, then released to the end of the dead zone.
    chain = chain_of(HALF_CIRCLE, pretension=0.0, load=spring(0.0, 1000.0))
    held_at(chain, 15.0)
    assert chain.load_force / chain.tension_in == pytest.approx(0.6341, abs=1e-4)
    assert chain.drive_move - chain.load_move == pytest.approx(1.9036e-3, abs=1e-7)
    held_at(chain, 6.031)
    assert chain.drive_move - chain.load_move == pytest.approx(1.2071e-3, abs=2e-7)


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_twice_the_elements_and_stiffer_bristles_change_no_channel_by_half_its_noise(kind):
    base = rig(sheath(kind))
    _, _, usual = followed(base, kind)
    finer = dataclasses.replace(base, numerics=Numerics(elements=2 * Numerics().elements))
    stiffer = dataclasses.replace(base, bristles=Bristles(breakaway_m=(0.5 * Bristles().breakaway_m[0],)))
    for other in (finer, stiffer):
        _, _, changed = followed(other, kind)
        assert_near(changed, usual, (8e-3, 1e-3, 1e-6))


@pytest.mark.parametrize(
    ("law", "most"),
    [
        ({"over_tension": laws.saturating(0.8, 4.0, 8.0), "over_travel": laws.worn(-0.3, 0.01)}, 1e-2),
        ({"over_speed": laws.stribeck(0.25, 3e-3, 6.0, 0.01)}, 2e-2),
    ],
)
def test_half_the_stride_changes_no_channel_where_friction_follows_the_state(law, most, monkeypatch):
    _, _, usual = followed(rig(sheath(0)), 1, **law)
    for name in ("STRIDE", "STRIDE_OVER_SPEED"):
        monkeypatch.setattr(rigs, name, rigs.Stride(*(0.5 * part for part in getattr(rigs, name))))
    _, _, halved = followed(rig(sheath(0)), 1, **law)
    assert_near(halved, usual, (most, 4e-3, 4e-6))


@pytest.mark.parametrize("breakaway", [(0.05e-6,), laws.dahl(0.2e-3)[0]])
def test_bristles_turn_to_heat_what_a_closed_cycle_takes(breakaway):
    share = (1.0 / len(breakaway),) * len(breakaway)
    chain = chain_of(
        sheath(1), "position", bristles=Bristles(breakaway_m=breakaway, share=share), near_friction=0.3
    )
    steps = np.concatenate([np.linspace(0.0, 8e-3, 400), np.linspace(8e-3, 2e-3, 400)])
    heat, move, tension = [], [], []
    for at in np.concatenate([steps, np.linspace(2e-3, 8e-3, 400), np.linspace(8e-3, 2e-3, 400)]):
        chain.advance(float(at), 0.01)
        heat.append(chain.dissipated)
        move.append(float(at))
        tension.append(chain.tension_in)
    assert np.min(np.diff(heat)) >= 0.0
    cycle = slice(len(steps) - 1, None)  # from the low point to the low point
    work = np.trapezoid(tension[cycle], move[cycle])
    assert heat[-1] - heat[len(steps) - 1] == pytest.approx(work, rel=2e-3)
    assert work > 0.005


@pytest.mark.parametrize("drive", ["position", "force"])
def test_a_hold_stays_still(drive):
    chain = chain_of(sheath(2), drive)
    for at in np.linspace(0.0, 6e-3, 80) if drive == "position" else np.linspace(3.0, 12.0, 80):
        chain.advance(float(at), 0.05)
    before = chain.tension_in, chain.load_force, chain.drive_move, chain.dissipated
    for _ in range(200):
        chain.advance(float(at), 0.05)
    assert (chain.tension_in, chain.load_force, chain.drive_move) == pytest.approx(before[:3], abs=1e-9)
    assert chain.dissipated == pytest.approx(before[3], abs=1e-12)


def test_creep_at_a_constant_tension_is_that_of_its_elements():
    chain = chain_of(sheath(0), friction=0.0, load=spring(3.0, 1e9))
    creep = ((0.08, 0.7), (0.15, 8.0))
    acts = Acts(creep=creep, compliance=3.16e-4)
    chain.advance(10.0, 1e-6, renew=acts.renew)
    acts.commit(chain, 1e-6)
    at_once = chain.drive_move - chain.load_move
    for _ in range(400):
        chain.advance(10.0, 0.02, renew=acts.renew)
        acts.commit(chain, 0.02)
    grown = (chain.drive_move - chain.load_move) / at_once - 1.0
    assert grown == pytest.approx(float(laws.crept(creep)(np.array(8.0))), rel=1e-4)


def test_unequal_friction_is_that_of_the_way_it_slides():
    route = sheath(0)
    chain, acts = chain_of(route), Acts(unequal=0.12)
    for tension, sign in ((16.0, -1.12), (1.2, 0.88)):
        for value in np.linspace(chain.tension_in, tension, 61)[1:]:
            chain.advance(float(value), 0.05, renew=acts.renew)
        ratio = chain.load_force / chain.tension_in
        assert ratio == pytest.approx(np.exp(sign * 0.145 * route.total_angle), rel=1e-4)


def test_fittings_hold_their_force_at_their_end():
    route = sheath(1)
    chain = chain_of(route, near_friction=0.5, load_friction=0.3)
    held_at(chain, 16.0)
    expected = (16.0 - 0.5) * np.exp(-0.145 * route.total_angle) - 0.3
    assert chain.load_force == pytest.approx(expected, rel=1e-4)


def test_a_spring_at_the_drive_takes_its_stretch_from_the_drive():
    tension = np.linspace(0.0, 100.0, 500)
    pull = Table(1e-4 * (tension - 3.0), tension)
    plain, soft = chain_of(sheath(0), "position"), chain_of(sheath(0), "position", pull=pull)
    for at in np.linspace(0.0, 6e-3, 60):
        soft.advance(float(at), 0.05)
    for at in np.linspace(0.0, 6e-3 - 1e-4 * (soft.tension_in - 3.0), 60):
        plain.advance(float(at), 0.05)
    assert soft.tension_in == pytest.approx(plain.tension_in, abs=1e-6)


def pair(**more):
    return Pair(0.12, 3e-4, 9.0, 0.01, 0.006, 0.03, [sheath(1, 3.0)], 0.8, **more)


def test_a_pair_turned_the_other_way_is_its_mirror_image():
    time = np.arange(1, 201) / 50.0
    motor = 0.5 * np.sin(2.0 * np.pi * time / 2.5)
    one = run_pair(pair(joint_friction=2e-3), sheath(1, 3.0), time, motor)
    other = run_pair(pair(joint_friction=2e-3), sheath(1, 3.0), time, -motor)
    assert other["joint_angle"] == pytest.approx(-one["joint_angle"], abs=1e-9)
    assert other["motor_torque"] == pytest.approx(-one["motor_torque"], abs=1e-9)
    for name in ("tension_in", "tension_out"):
        assert other[f"{name}_1"] == pytest.approx(one[f"{name}_2"], abs=1e-6)


def test_the_joint_of_a_pair_is_in_balance():
    time = np.arange(1, 201) / 50.0
    true = run_pair(pair(), sheath(1, 3.0), time, 0.5 * np.sin(2.0 * np.pi * time / 2.5))
    torque = 0.006 * (true["tension_out_1"] - true["tension_out_2"])
    assert torque == pytest.approx(0.03 * true["joint_angle"], abs=1e-9)
    assert np.ptp(true["joint_angle"]) > 0.5
