"""Every unit of laboratory files has the size that NIST SP 811, appendix B, and the SI brochure give it."""

from typing import get_args

import pytest

from tssgeom.io.formats.laboratory.names import split_unit
from tssgeom.io.formats.laboratory.units import UNITS, scaled_unit, unit_of
from tssgeom.io.formats.lengths import LengthUnit
from tssgeom.io.formats.recording import PER_METRE

IN_SI = {
    "N": 1.0,
    "mN": 1e-3,
    "uN": 1e-6,
    "cN": 1e-2,
    "daN": 10.0,
    "kN": 1e3,
    "kgf": 9.80665,
    "gf": 9.80665e-3,
    "lbf": 4.4482216152605,
    "ozf": 0.27801385095378125,
    "m": 1.0,
    "dm": 0.1,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "nm": 1e-9,
    "in": 0.0254,
    "mil": 25.4e-6,
    "ft": 0.3048,
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
    "rad": 1.0,
    "mrad": 1e-3,
    "deg": 0.017453292519943295,
    "Nm": 1.0,
    "Ncm": 1e-2,
    "Nmm": 1e-3,
    "mNm": 1e-3,
    "lbf·in": 0.1129848290276167,
    "ozf·in": 0.007061551814226043,
    "A": 1.0,
    "mA": 1e-3,
    "C": 1.0,
    "K": 1.0,
    "°F": 0.5555555555555556,
    "1/m": 1.0,
    "1/cm": 100.0,
    "1/mm": 1e3,
    "deg/m": 0.017453292519943295,
    "deg/mm": 17.453292519943295,
}
"""How many newtons, metres, seconds, radians and so on one of each is."""


def test_a_user_may_state_each_unit_of_length_of_a_header():
    lengths = {unit.factor for unit in UNITS.values() if unit.quantity == "length"}
    assert {UNITS[unit].factor for unit in get_args(LengthUnit)} == lengths
    assert len(get_args(LengthUnit)) == len(lengths)
    for unit in get_args(LengthUnit):
        assert PER_METRE[unit] * IN_SI[unit] == pytest.approx(1.0, rel=1e-14)
    assert [PER_METRE[unit] for unit in ("mm", "cm", "dm", "um", "nm")] == [1e3, 1e2, 10.0, 1e6, 1e9]


def test_each_unit_has_its_size():
    assert {name: UNITS[name].factor for name in IN_SI} == pytest.approx(IN_SI, rel=1e-12)
    sizes = {(UNITS[name].quantity, UNITS[name].factor) for name in IN_SI}
    assert {(unit.quantity, unit.factor) for unit in UNITS.values()} == sizes  # none is missing here


@pytest.mark.parametrize(("symbol", "freezing", "boiling"), [("K", 273.15, 373.15), ("°F", 32.0, 212.0)])
def test_a_temperature_has_its_zero(symbol, freezing, boiling):
    unit = UNITS[symbol]
    celsius = [unit.factor * value + unit.offset for value in (freezing, boiling)]
    assert celsius == pytest.approx([0.0, 100.0], abs=1e-9)


@pytest.mark.parametrize(("text", "symbol"), [("MM", "mm"), ("N mm", "Nmm"), ("mN·m", "mNm"), ("µm", "um")])
def test_a_unit_is_known_by_its_other_spellings(text, symbol):
    unit, known = unit_of(text), UNITS[symbol]
    assert unit is not None
    assert (unit.quantity, unit.factor) == (known.quantity, known.factor)


@pytest.mark.parametrize(
    "header", ["tension [N]", "tension (N)", "tension / N", "tension, N", "tension in N", "tension_N"]
)
def test_a_unit_stands_behind_the_name_of_its_column(header):
    name, unit = split_unit(header)
    assert unit is not None
    assert (name, unit.symbol) == ("tension", "N")


@pytest.mark.parametrize("text", ["MN", "m s", "parsec", ""])
def test_what_is_no_unit_is_none(text):
    assert unit_of(text) is None


@pytest.mark.parametrize(("text", "factor"), [("-N", -1.0), ("0.2094mm", 2.094e-4), ("2e3 * m", 2e3)])
def test_a_factor_stands_before_its_unit(text, factor):
    unit = scaled_unit(text)
    assert unit is not None
    assert unit.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("text", ["0mm", "1e999 m", "3", "2 parsec"])
def test_a_factor_without_size_or_unit_is_refused(text):
    assert scaled_unit(text) is None
