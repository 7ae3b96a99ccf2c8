"""The library of effects that the base model lacks: a closed union, each selected by its name.

To add one: write its class and name it in `Library`. It then loads from rig files, and the contract tests
hold it.
"""

from collections.abc import Iterable
from typing import Any, TypeAlias, get_args

import msgspec

from tssgeom.effects.elastic import (
    Creep,
    SeriesComplianceDistal,
    SeriesComplianceProximal,
    SlackTakeUp,
    ThermalDrift,
    ToeRegion,
)
from tssgeom.effects.ends import (
    Backlash,
    ChannelLag,
    LoadCellCrosstalk,
    LoadFriction,
    LoadPlay,
    PretensionError,
    TensionInGain,
    TensionInOffset,
    TensionOutGain,
    TensionOutOffset,
)
from tssgeom.effects.friction import (
    AsymmetricFriction,
    CurvatureDependentFriction,
    EndFittingFrictionDistal,
    EndFittingFrictionProximal,
    FrictionDrift,
    LoadDependentFriction,
    Presliding,
    StraightSectionFriction,
    VelocityDependentFriction,
    ViscousDrag,
)
from tssgeom.effects.kinds import Channel, Effect, Parameter, Setup, Tie, snake
from tssgeom.effects.laws import CreepLaw, FrictionLaw, Law, LoadLaw, SensorLaw, StretchLaw
from tssgeom.effects.route import HiddenBend, SheathClearance
from tssgeom.errors import SettingsError

Library: TypeAlias = (
    LoadDependentFriction
    | VelocityDependentFriction
    | ViscousDrag
    | StraightSectionFriction
    | CurvatureDependentFriction
    | AsymmetricFriction
    | FrictionDrift
    | Presliding
    | EndFittingFrictionProximal
    | EndFittingFrictionDistal
    | HiddenBend
    | SheathClearance
    | SlackTakeUp
    | ToeRegion
    | Creep
    | SeriesComplianceProximal
    | SeriesComplianceDistal
    | ThermalDrift
    | PretensionError
    | Backlash
    | LoadFriction
    | LoadPlay
    | TensionInGain
    | TensionOutGain
    | TensionInOffset
    | TensionOutOffset
    | ChannelLag
    | LoadCellCrosstalk
)
"""Any effect with a formula; `name` in a rig file selects which."""
AnyEffect: TypeAlias = Library | Law
"""Any effect, those that are curves included."""

KINDS: dict[str, type[Library]] = {snake(kind.__name__): kind for kind in get_args(Library)}
"""Every effect by its name, in the order of the reports."""
LAWS: dict[str, type[Law]] = {snake(kind.__name__): kind for kind in get_args(Law)}
"""Every law that is a curve by its name."""
_MAY_REPEAT = (HiddenBend, ChannelLag, SlackTakeUp, FrictionLaw, StretchLaw, SensorLaw)


def named(effects: Iterable[AnyEffect]) -> str:
    """Return the names of effects as they stand in a rig file, for a sentence."""
    return ", ".join(snake(type(effect).__name__) for effect in effects)


def with_size(kind: type[Library], size: float = 1.0) -> Library:
    """Return the effect at `size` times what is typical; 0 switches it off, scales stay typical."""
    parameters = kind.parameters.items()
    numbers: dict[str, Any] = {key: p.typical * size if p.switch else p.typical for key, p in parameters}
    return kind(**numbers)


def chosen(effect: msgspec.Struct) -> dict[str, str]:
    """Return what of an effect is a choice and no number, such as the end at which it acts."""
    values = {key: getattr(effect, key) for key in effect.__struct_fields__}
    return {key: value for key, value in values.items() if isinstance(value, str)}


def together(setup: Setup, effects: Iterable[AnyEffect]) -> Setup:
    """Return the setup with all effects in it.

    Raises SettingsError where an effect that can act once is given twice.
    """
    once = set()
    for effect in effects:
        if type(effect) in once:
            raise SettingsError(f"effects: {snake(type(effect).__name__)} is given twice; keep one of them")
        if not isinstance(effect, _MAY_REPEAT):
            once.add(type(effect))
        setup = effect.on(setup)
    return setup


def wrong_effect(rig: dict[str, Any]) -> str:
    """Say which effect of a rig file is wrong, and what there is to choose from."""
    tables = rig["effects"]
    for i, table in enumerate(tables if isinstance(tables, list) else []):
        try:
            msgspec.convert(table, type=AnyEffect)
        except msgspec.ValidationError as error:
            kind = (KINDS | LAWS).get(str(table.get("name"))) if isinstance(table, dict) else None
            known = ", ".join(kind.__struct_fields__ if kind else (*KINDS, *LAWS))
            return f"effects[{i}]: {error}; {'its parameters' if kind else 'effects'} are {known}"
    return "effects is no list of tables; write each as [[effects]]"


__all__ = [
    "KINDS",
    "LAWS",
    "AnyEffect",
    "AsymmetricFriction",
    "Backlash",
    "Channel",
    "ChannelLag",
    "Creep",
    "CreepLaw",
    "CurvatureDependentFriction",
    "Effect",
    "EndFittingFrictionDistal",
    "EndFittingFrictionProximal",
    "FrictionDrift",
    "FrictionLaw",
    "HiddenBend",
    "Law",
    "Library",
    "LoadCellCrosstalk",
    "LoadDependentFriction",
    "LoadFriction",
    "LoadLaw",
    "LoadPlay",
    "Parameter",
    "Presliding",
    "PretensionError",
    "SensorLaw",
    "SeriesComplianceDistal",
    "SeriesComplianceProximal",
    "Setup",
    "SheathClearance",
    "SlackTakeUp",
    "StraightSectionFriction",
    "StretchLaw",
    "TensionInGain",
    "TensionInOffset",
    "TensionOutGain",
    "TensionOutOffset",
    "ThermalDrift",
    "Tie",
    "ToeRegion",
    "VelocityDependentFriction",
    "ViscousDrag",
    "chosen",
    "named",
    "snake",
    "together",
    "with_size",
    "wrong_effect",
]
