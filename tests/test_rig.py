"""The rig: defaults, bounds, and the TOML file."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tssgeom.errors import SettingsError, SourceError, TssgeomError
from tssgeom.rig import Friction, Load, Rig, Sensor, ShapeSensor, Tendon, read_rig

COMPLETE = """
[tendon]
compliance_per_N = 2e-4
pretension_N = 3.0
[friction]
coefficient = 0.2
[load]
stiffness_N_per_m = 500.0
[sensors.tension_in]
noise = 0.02
resolution = 0.01
full_scale = 110.0
nonlinearity = 0.0025
[shape]
noise_mm = 0.5
angle_gain_sd = 0.01
"""


def written(folder, text):
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_defaults_are_the_papers():
    rig = Rig()
    assert (rig.tendon.compliance_per_N, rig.friction.coefficient) == (3.16e-4, 0.145)
    assert rig.tendon.pretension_N == 0.0


def test_every_key_of_a_file_arrives(tmp_path):
    rig = read_rig(written(tmp_path, COMPLETE))
    assert rig == Rig(
        tendon=Tendon(compliance_per_N=2e-4, pretension_N=3.0),
        friction=Friction(coefficient=0.2),
        load=Load(stiffness_N_per_m=500.0),
        sensors={"tension_in": Sensor(noise=0.02, resolution=0.01, full_scale=110.0, nonlinearity=0.0025)},
        shape=ShapeSensor(noise_mm=0.5, angle_gain_sd=0.01),
    )


def test_an_empty_file_is_the_default_rig(tmp_path):
    assert read_rig(written(tmp_path, "")) == Rig()


@given(st.floats(0, 1e3), st.floats(0, 1e3), st.floats(0, 10))
def test_python_and_toml_hold_the_same_rig(compliance, pretension, friction):
    text = f"""
    tendon = {{compliance_per_N = {compliance!r}, pretension_N = {pretension!r}}}
    friction = {{coefficient = {friction!r}}}
    """
    tendon = Tendon(compliance_per_N=compliance, pretension_N=pretension)
    assert msgspec.toml.decode(text, type=Rig) == Rig(tendon=tendon, friction=Friction(coefficient=friction))


def test_shape_noise_is_given_in_mm_and_used_in_m():
    assert ShapeSensor(noise_mm=0.5).noise == pytest.approx(5e-4, rel=1e-15)  # one rounding
    assert ShapeSensor().noise is None


OUT_OF_BOUNDS = [
    (Tendon, "compliance_per_N", "tendon.compliance_per_N"),
    (Tendon, "pretension_N", "tendon.pretension_N"),
    (Friction, "coefficient", "friction.coefficient"),
    (Load, "stiffness_N_per_m", "load.stiffness_N_per_m"),
    (Sensor, "noise", "noise"),
    (Sensor, "resolution", "resolution"),
    (Sensor, "full_scale", "full_scale"),
    (Sensor, "nonlinearity", "nonlinearity"),
    (ShapeSensor, "noise_mm", "shape.noise_mm"),
    (ShapeSensor, "angle_gain_sd", "shape.angle_gain_sd"),
]


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
@pytest.mark.parametrize(("part", "key", "path"), OUT_OF_BOUNDS)
def test_a_value_out_of_bounds_is_refused_with_path_value_and_hint(part, key, path, value):
    remedy = "give a (finite value > 0|value from 0 to 1e12)"
    with pytest.raises(SettingsError, match=f"{path} is {value:g}: {remedy}") as caught:
        part(**{key: value})
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, TssgeomError)


@pytest.mark.parametrize("part", [Tendon, Friction, Load])
def test_zero_is_within_bounds(part):
    for key in part.__struct_fields__:
        assert getattr(part(**{key: 0.0}), key) == 0.0


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("[tendon]\nstiffness = 3.0\n", r"stiffness.*\$\.tendon"),
        ("[frictoin]\ncoefficient = 0.1\n", "frictoin"),
        ("[sensors.tension_in]\nnoize = 1.0\n", r"noize.*\$\.sensors"),
        ("[friction]\ncoefficient = -0.1\n", r"friction\.coefficient is -0\.1"),
        ('[friction]\ncoefficient = "much"\n', r"\$\.friction\.coefficient"),
        ("[friction\n", "mend the rig file"),
    ],
)
def test_a_wrong_file_is_refused_with_its_name_and_the_key(tmp_path, text, reported):
    path = written(tmp_path, text)
    with pytest.raises(SettingsError, match=reported) as caught:
        read_rig(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused_with_its_name(tmp_path):
    with pytest.raises(SettingsError, match=r"nowhere\.toml: cannot read the rig file .*: check the path"):
        read_rig(tmp_path / "nowhere.toml")


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingsError, match="mend the rig file"):
        read_rig(path)


def test_a_file_without_an_end_is_refused():
    with pytest.raises(SourceError, match=r"/dev/zero: .*: save it as a file"):
        read_rig("/dev/zero")


def test_a_rig_cannot_be_changed():
    with pytest.raises(AttributeError):
        Rig().tendon = Tendon()


def test_a_rig_of_an_editor_that_marks_its_bytes_is_read(tmp_path):
    (tmp_path / "rig.toml").write_bytes(b"\xef\xbb\xbf[friction]\ncoefficient = 0.2\n")
    assert read_rig(tmp_path / "rig.toml").friction.coefficient == 0.2
