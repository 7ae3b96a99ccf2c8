"""Write a campaign of measured runs whose cause is known, and hidden from its files.

    from tests.bristle import make_campaign
    truth = make_campaign(Path("here"), seed=3, cause="stribeck")

The truth stands beside the folder, in `<folder>.truth.json`.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.bristle.causes import CAUSES, FULL, Case, Cause
from tests.bristle.laws import Law
from tests.bristle.machine import PAIR_CAUSES, PAIR_PLANS, PAIR_SLOWEST, random_pair, write_pair
from tests.bristle.rig import Rig
from tests.bristle.sheath import random_sheath
from tests.bristle.writing import RANGES, Writing

Array = np.ndarray

SEEDS = {"development": 407_000_000, "test": 811_000_000}
"""First seed of each split; a million each."""
MECHANISMS = tuple(dict.fromkeys(cause.mechanism for cause in CAUSES.values()))


@dataclass(frozen=True)
class Truth:
    """What a report is held against.

    `law` holds `over`, `x`, `value` and `unit` over what the runs reach; a law of friction is a factor
    relative to the coefficient at the reference of the law, others are what is added [the unit].
    """

    effects: tuple[str, ...]
    """The name of the library, or that of the cause where it has none; none of a clean campaign."""
    cause: str
    mechanism: str
    formula: str | None
    known: bool
    """Whether the library has the formula."""
    law: dict[str, Any] | None
    parameters: dict[str, dict[str, float]]
    friction: float
    compliance_per_N: float
    pretension_N: float
    angle_gain: float
    length_m: float
    total_angles_rad: tuple[float, ...]
    plan: str
    split: str
    seed: int
    size: float


def generator(seed: int, split: str, cause: str) -> np.random.Generator:
    """Return the random numbers of a seed: each cause has rigs of its own, the same at each size.

    Raises
    ------
    ValueError
        Where the seed is not in its split.
    """
    if not 0 <= seed < 1_000_000:
        raise ValueError(f"seed {seed}: 0 to 999999")
    return np.random.default_rng([SEEDS[split] + seed, zlib.crc32(cause.encode())])


def make_campaign(
    folder: Path,
    seed: int,
    cause: str = "",
    size: float = 1.0,
    plan: str = "",
    split: str = "development",
) -> Truth:
    """Write a campaign into `folder` and its truth beside it, as `<folder>.truth.json`.

    Parameters
    ----------
    folder
        Made where it is not there.
    seed
        0 to 999999.
    cause
        A name of `CAUSES`, or "" for a clean campaign.
    size
        1 is what rigs show, 0.5 half of it.
    plan
        A name of `PLANS`; "" takes one in which the cause shows, by the seed.
    split
        "development" or "test".

    Raises
    ------
    ValueError
        Where a name is not known, or the cause does not show in the plan.
    """
    if cause and cause not in {**CAUSES, **PAIR_CAUSES}:
        raise ValueError(f"no such cause: {cause}")
    rng = generator(seed, split, cause)
    if cause in PAIR_CAUSES or plan in PAIR_PLANS:
        truth = _of_pair(Path(folder), rng, (cause, size, plan, split, seed))
    else:
        truth = _of_one(Path(folder), rng, (cause, size, plan, split, seed))
    text = json.dumps(asdict(truth), indent=1)
    Path(f"{folder}.truth.json").write_text(text + "\n", encoding="utf-8")
    return truth


def _of_one(folder: Path, rng: np.random.Generator, asked: tuple[str, float, str, str, int]) -> Truth:
    """Write a campaign of one tendon."""
    cause, size, plan, split, seed = asked
    chosen = CAUSES[cause] if cause else Cause("", lambda case: None)
    plan = plan or str(rng.choice(chosen.plans))
    if plan not in (chosen.plans if cause else FULL):
        raise ValueError(f"{cause} does not show in the plan {plan!r}")
    rig = _rig(rng, "force" if plan == "force" else "position")
    runs = int(rng.integers(RANGES.runs[0], RANGES.runs[1] + 1))
    rates = [
        chosen.rates[k % len(chosen.rates)] for k in rng.permutation(max(runs, len(chosen.rates)))[:runs]
    ]
    samples = [int(rng.integers(*RANGES.samples)) for _ in range(runs)]
    seconds = max(n / rate for n, rate in zip(samples, rates, strict=True))
    case = Case(rig, rng, size, float(rng.uniform(*RANGES.peak_out_N)), seconds)
    believed = {
        "friction": rig.friction * (1.0 + RANGES.friction_error * rng.uniform(-1.0, 1.0)),
        "compliance": rig.compliance * (1.0 + RANGES.compliance_error * rng.uniform(-1.0, 1.0)),
        "pretension": rig.pretension,
        "stiffness": rig.stiffness,
    }
    chosen.build(case)
    believed |= case.believed
    kept = Writing(folder, case, plan, believed)
    reach = kept.write(samples, rates)
    return Truth(
        effects=(chosen.formula or cause,) if cause else (),
        cause=cause,
        mechanism=chosen.mechanism,
        formula=chosen.formula,
        known=chosen.formula is not None,
        law=_law(case.law, reach),
        parameters={(chosen.formula or cause): case.parameters} if case.parameters else {},
        friction=rig.friction,
        compliance_per_N=rig.compliance,
        pretension_N=rig.pretension,
        angle_gain=kept.angle_gain,
        length_m=rig.sheaths[0].length,
        total_angles_rad=tuple(sheath.total_angle for sheath in rig.sheaths),
        plan=plan,
        split=split,
        seed=seed,
        size=size,
    )


def _of_pair(folder: Path, rng: np.random.Generator, asked: tuple[str, float, str, str, int]) -> Truth:
    """Write a campaign of two tendons and a joint."""
    cause, size, plan, split, seed = asked
    plan = plan or str(rng.choice(list(PAIR_PLANS)))
    if plan not in PAIR_PLANS or (cause and cause not in PAIR_CAUSES):
        raise ValueError(f"{cause} does not show in the plan {plan!r}")
    pair = random_pair(rng)
    mechanism, build = PAIR_CAUSES.get(cause, ("", lambda *_: None))
    build(pair, size, RANGES.samples[1] / PAIR_SLOWEST)
    errors = RANGES.friction_error * rng.uniform(-1.0, 1.0), RANGES.compliance_error * rng.uniform(-1.0, 1.0)
    gain = 1.0 + RANGES.angle_gain_sd * rng.normal()
    reach = write_pair(folder, pair, rng, plan, errors, gain)
    return Truth(
        effects=(cause,) if cause else (),
        cause=cause,
        mechanism=mechanism,
        formula=None,
        known=False,
        law=_law(pair.law, reach),
        parameters={cause: pair.parameters} if pair.parameters else {},
        friction=pair.friction,
        compliance_per_N=pair.compliance,
        pretension_N=pair.pretension,
        angle_gain=gain,
        length_m=pair.sheaths[0].length,
        total_angles_rad=tuple(sheath.total_angle for sheath in pair.sheaths),
        plan=plan,
        split=split,
        seed=seed,
        size=size,
    )


def _rig(rng: np.random.Generator, drive: str) -> Rig:
    length = rng.uniform(*RANGES.length_m)
    kinds = rng.permutation(3)[: int(rng.integers(2, 4))]
    return Rig(
        friction=rng.uniform(*RANGES.friction),
        compliance=rng.uniform(*RANGES.compliance_per_N),
        pretension=round(rng.uniform(*RANGES.pretension_N), 2),
        stiffness=round(rng.uniform(*RANGES.stiffness_N_per_m), -1),
        sheaths=[random_sheath(rng, length, rng.uniform(*RANGES.total_angle_rad), int(k)) for k in kinds],
        drive=drive,
    )


LAW_POINTS = 60


def _law(law: tuple[str, str, Law] | None, reach: dict[str, tuple[float, float]]) -> dict[str, Any] | None:
    """Return the true law where the runs have been."""
    if law is None:
        return None
    over, unit, value_at = law
    x = np.linspace(*reach[over], 2 if over == "direction" else LAW_POINTS)
    value = np.broadcast_to(value_at(x), x.shape)
    return {"over": over, "x": x.tolist(), "value": value.tolist(), "unit": unit}
