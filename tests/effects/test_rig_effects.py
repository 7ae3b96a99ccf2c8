"""Effects in a rig file."""

import json

import msgspec
import pytest

from tssgeom.effects import KINDS, HiddenBend, SlackTakeUp, with_size
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig, read_rig


def written(folder, text):
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_effects_of_a_file_arrive_in_their_order(tmp_path):
    path = written(
        tmp_path,
        '[[effects]]\nname = "hidden_bend"\nat_m = 0.2\nangle_rad = 0.4\n'
        '[[effects]]\nname = "slack_take_up"\nslack_m = 1.69e-3\nend = "distal"\n',
    )
    bend, slack = HiddenBend(at_m=0.2, angle_rad=0.4), SlackTakeUp(slack_m=1.69e-3, end="distal")
    assert read_rig(path) == Rig(effects=(bend, slack))


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_effect_is_saved_and_read_back(tmp_path, kind):
    rig = Rig(effects=(with_size(kind),))
    (table,) = msgspec.to_builtins(rig)["effects"]
    lines = [
        f"{key} = {json.dumps(value)}" for key, value in table.items()
    ]  # numbers and words are as in TOML
    assert read_rig(written(tmp_path, "\n".join(["[[effects]]", *lines]))) == rig


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ('name = "hidden_bent"', r"effects\[0\]: .*hidden_bent.*effects are .*hidden_bend, .*creep"),
        ('name = "creep"\nratioo = 1.0', r"effects\[0\]: .*`ratioo`.*its parameters are ratio, time_s"),
        ('name = "creep"', r"effects\[0\]: .*missing required field `ratio`.*are ratio, time_s"),
        ('name = "creep"\nratio = -1.0', r"effects\.creep\.ratio is -1: give 0 to 2"),
        ("ratio = 1.0", r"effects\[0\]: .*`name`.*effects are load_dependent_friction"),
    ],
)
def test_a_wrong_effect_is_refused_with_what_there_is(tmp_path, text, reported):
    path = written(tmp_path, "[[effects]]\n" + text)
    with pytest.raises(SettingsError, match=reported) as caught:
        read_rig(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_effects_that_are_no_list_are_refused(tmp_path):
    with pytest.raises(SettingsError, match=r"write each as \[\[effects\]\]"):
        read_rig(written(tmp_path, '[effects]\nname = "creep"\n'))
