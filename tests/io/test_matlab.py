"""MATLAB files: what is damaged is one line, where the library that reads them would crash."""

import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.laboratory.matlab import matlab_variables

NESTED = {
    "s": {"x": np.arange(5.0), "names": ["a", "bb"], "cells": np.array([1, "t", np.eye(2)], dtype=object)},
    "z": np.eye(3) + 1j,
    "flags": np.array([True, False]),
    "empty": np.zeros((0, 3)),
    "text": "text",
}


@pytest.mark.parametrize("options", [{}, {"do_compression": True}])
def test_arrays_of_every_class_are_read(tmp_path, options):
    savemat(tmp_path / "data.mat", NESTED, **options)
    held = matlab_variables(tmp_path / "data.mat")
    assert held.keys() == NESTED.keys()
    np.testing.assert_array_equal(held["z"], NESTED["z"])
    np.testing.assert_array_equal(held["s"]["x"], NESTED["s"]["x"])
    np.testing.assert_array_equal(held["s"]["cells"][2], np.eye(2))


def test_version_4_is_read(tmp_path):
    savemat(tmp_path / "old.mat", {"x_mm": np.arange(5.0)}, format="4")
    assert matlab_variables(tmp_path / "old.mat")["x_mm"].tolist() == [0, 1, 2, 3, 4]


def with_kind_of_numbers(path: Path, kind: int) -> None:
    """Write an array of two numbers with another kind of element for them."""
    savemat(path, {"x": np.arange(2.0) + 0.5})
    raw = path.read_bytes()
    at = raw.index(struct.pack("<II", 9, 16))
    path.write_bytes(raw[:at] + struct.pack("<II", kind, 16) + raw[at + 8 :])


@pytest.mark.parametrize("kind", [0, 8, 10, 14, 15, 19, 25, 255])
def test_a_kind_of_numbers_that_does_not_exist_is_refused(tmp_path, kind):
    with_kind_of_numbers(tmp_path / "data.mat", kind)
    with pytest.raises(ValueError, match=re.escape(f"kind {kind} for an array")):
        matlab_variables(tmp_path / "data.mat")


def test_a_packed_array_is_checked_too(tmp_path):
    path = tmp_path / "data.mat"
    with_kind_of_numbers(path, 25)
    packed = zlib.compress(path.read_bytes()[128:])
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(ValueError, match="kind 25 for an array"):
        matlab_variables(path)


def test_what_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("TSSGEOM_MOST_MIB", "1")
    savemat(tmp_path / "data.mat", {"x": np.zeros(300_000)}, do_compression=True)
    with pytest.raises(SourceError, match="unpacked it takes"):
        matlab_variables(tmp_path / "data.mat")


def test_an_array_cut_anywhere_is_refused(tmp_path):
    savemat(tmp_path / "whole.mat", {"s": NESTED["s"]})
    whole = (tmp_path / "whole.mat").read_bytes()
    for end in range(129, len(whole), 7):
        (tmp_path / "cut.mat").write_bytes(whole[:end])
        with pytest.raises(ValueError, match="cut short"):
            matlab_variables(tmp_path / "cut.mat")


def test_two_arrays_that_may_each_be_the_points_are_refused_by_name(tmp_path):
    points = np.cumsum(np.ones((5, 3)), axis=0)
    savemat(tmp_path / "two.mat", {"left": points, "right": 2.0 * points, "turn": np.eye(3)})
    with pytest.raises(ShapeError, match="left, right may each be the points: save one of them"):
        open_recording(tmp_path / "two.mat", "mm")


HDF5 = b"\x89HDF\r\n\x1a\n"
HEAD = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan 15 12:00:00 2024 HDF5 schema 1.00 ."


@pytest.mark.parametrize("content", [HEAD.ljust(124) + b"\x00\x02IM".ljust(388, b"\0") + HDF5, HDF5])
def test_version_7_3_is_refused_with_what_to_type_in_matlab_whatever_its_size(tmp_path, content):
    path = tmp_path / "trial.mat"
    path.write_bytes(content + bytes(1000))
    with path.open("r+b") as file:
        file.truncate(200 << 20)
    with pytest.raises(
        SourceError, match=r"save\('trial_v7.mat', '-v7'\), or writematrix\(points, 'trial.csv'\)"
    ):
        open_recording(path, "mm")


def test_two_variables_of_one_name_are_refused(tmp_path):
    path = tmp_path / "data.mat"
    savemat(path, {"x_mm": np.arange(5.0), "y_mm": np.arange(5.0), "z_mm": np.arange(5.0)})
    path.write_bytes(path.read_bytes().replace(b"y_mm", b"x_mm"))
    with pytest.raises(SourceError, match='Duplicate variable name "x_mm"'):
        open_recording(path)


@pytest.mark.parametrize("count", [2, 4])
def test_units_of_another_number_than_the_columns_are_refused(tmp_path, count):
    units = ["mm"] * count
    points = np.random.default_rng(1).normal(size=(6, 3))
    savemat(tmp_path / "data.mat", {"data": points, "units": np.array(units, dtype=object)})
    with pytest.raises(ShapeError, match=f"{count} units for 3 columns"):
        open_recording(tmp_path / "data.mat")


def test_an_empty_unit_is_none_and_units_of_numbers_are_no_units(tmp_path):
    columns = np.column_stack([np.arange(6.0), np.random.default_rng(1).normal(size=(6, 3))])
    named = {"data": columns, "names": np.array(["Nr", "x", "y", "z"], dtype=object)}
    savemat(tmp_path / "data.mat", named | {"units": np.array(["", "mm", "mm", "mm"], dtype=object)})
    assert open_recording(tmp_path / "data.mat").unit == "mm"
    savemat(tmp_path / "data.mat", named | {"units": np.arange(8.0).reshape(2, 4)})
    assert open_recording(tmp_path / "data.mat", "m").unit == "m"
