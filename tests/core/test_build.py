"""How the core is built and called: equal digits on every processor, and mistakes in a header are named."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tssgeom.core import build
from tssgeom.errors import FitError

_DIGEST = """
import hashlib, numpy as np
from tssgeom import Frame, Rig, process
rng, digest = np.random.default_rng(0), hashlib.sha256()
s = np.linspace(0.0, 1.0, 150)
frames = []
for k in range(40):
    turn = 2.5 * np.sin(3.0 * s + 0.02 * k) * (1.0 if k < 25 else (s > 0.4))
    tangent = np.column_stack((np.cos(turn), np.sin(turn), 0.3 * s))
    points = 0.4 * np.cumsum(tangent, axis=0) / 150 + 3e-4 * rng.normal(size=(150, 3))
    frames.append(Frame(points, 0.02 * k, tension_in=10.0 + k % 7))
for result in process(frames, Rig(), tension_in=15.0):
    for array in (result.arcs.length, result.arcs.angle, result.arcs.covariance, result.profile.phi_se):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(np.float64(result.transmission.elongation).tobytes())
print(digest.hexdigest())
"""


def digest(**more: str) -> str:
    """Hash all digits of a stream in a process of its own."""
    env = os.environ | more
    done = subprocess.run(
        [sys.executable, "-c", _DIGEST], env=env, capture_output=True, text=True, check=True
    )
    return done.stdout


def test_digits_are_equal_with_and_without_the_instructions_of_this_processor():
    assert digest(TSSGEOM_NO_AVX2="1") == digest(TSSGEOM_NO_AVX2="")


def test_without_a_compiler_the_error_names_both_ways_out(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setitem(sys.modules, "ziglang", None)
    with pytest.raises(build.NoCompilerError, match=r"install one \(gcc, clang\) or `pip install ziglang`"):
        build.build(tmp_path)


def test_an_error_of_the_compiler_is_reported(monkeypatch, tmp_path):
    with pytest.raises(RuntimeError, match="the core does not compile"):
        build.build(tmp_path, flags=["-D_TSSGEOM_MISTAKE", "-include", "no_such_header.h"])
    assert list(tmp_path.iterdir()) == []  # nothing half built is left


@pytest.mark.parametrize(
    ("source", "mistake"),
    [
        ("/** Text. */\nENTRY double tss_x(float y) {", "not in the form of its conventions: 'float y'"),
        (
            "/** Text. */\nENTRY void tss_x(int64_t n, double y[n]) {",
            "y is changed: mark it OUT",
        ),
        ("\nENTRY double tss_x(double y) {", "every ENTRY needs a comment"),
    ],
)
def test_an_entry_that_breaks_a_convention_is_refused(source, mistake):
    with pytest.raises(ValueError, match=mistake):
        build.read_prototypes(source)


def test_a_library_older_than_a_source_is_built_again(tmp_path):
    assert build.is_stale(tmp_path)
    for name in build.library_flags():
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (2e9, 2e9))
    assert not build.is_stale(tmp_path)
    for name in build.library_flags():
        os.utime(tmp_path / name, (1e9, 1e9))
    assert build.is_stale(tmp_path)


def test_each_return_code_of_the_core_has_its_sentence():
    from tssgeom.core.binding import failed

    header = (Path(build.HERE) / "core.h").read_text(encoding="utf-8")
    codes = [
        line.split("=")[1].split(",")[0]
        for line in header.splitlines()
        if line.startswith("    ") and " = " in line
    ]
    assert codes
    for code in codes[1:]:
        with pytest.raises(FitError) as error:
            failed(int(code), "an entry")
        assert "code" not in str(error.value)
