"""Meshes of the lumen: the file beside the shape, read in metres."""

import numpy as np
import pytest
import trimesh

from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.meshes import ENDINGS, lumen_beside, read_lumen


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize(("unit", "size"), [("mm", 0.04), ("m", 40.0)])
def test_every_format_is_read_in_metres(tmp_path, ending, unit, size):
    path = tmp_path / f"colon_lumen{ending}"
    trimesh.creation.box(extents=(40, 40, 40)).export(path)
    np.testing.assert_allclose(read_lumen(path, unit).extents, size, rtol=1e-6)  # STL holds float32


def test_the_lumen_of_a_shape_is_read_by_its_name(tmp_path):
    for name in ("colon_lumen.ply", "colon_lumen.stl", "colon_left_lumen.stl", "col_lumen.ply"):
        (tmp_path / name).touch()
    expected = {
        "colon.csv": "colon_lumen.ply",
        "colon_fibre.csv": "colon_lumen.ply",
        "colon_left.npz": "colon_left_lumen.stl",
        "colon_left-2.npz": "colon_left_lumen.stl",
    }
    for shape, mesh in expected.items():
        assert lumen_beside(tmp_path / shape) == tmp_path / mesh


@pytest.mark.parametrize("shape", ["colonoscope.csv", "aorta.csv", "co.csv"])
def test_a_name_that_only_begins_alike_has_no_lumen(tmp_path, shape):
    (tmp_path / "colon_lumen.ply").touch()
    assert lumen_beside(tmp_path / shape) is None
    assert lumen_beside(tmp_path / "no folder" / shape) is None


@pytest.mark.parametrize(
    ("name", "content", "error", "says"),
    [
        ("a_lumen.ply", b"no mesh", SourceError, "cannot be read as a mesh"),
        ("a_lumen.stl", b"", (ShapeError, SourceError), "mesh"),
        ("a_lumen.glb", b"glTF", SourceError, "cannot be read as a mesh"),
        ("a_lumen.obj", b"v 0 0 0\n", (ShapeError, SourceError), "mesh"),
        ("a_lumen.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", ShapeError, "impossible corners"),
        (
            "a_lumen.stl",
            b" " * 80 + b"\1\0\0\0" + b"\xff\xff\x7f\x7f" * 12 + b"\0\0",
            ShapeError,
            "impossible",
        ),
        ("a_lumen.txt", b"", SourceError, "no reader takes '.txt' as a mesh"),
        (None, b"", SourceError, "no such file"),
    ],
)
def test_a_broken_mesh_is_refused_in_one_line(tmp_path, name, content, error, says):
    path = tmp_path / (name or "missing_lumen.ply")
    if name:
        path.write_bytes(content)
    with pytest.raises(error) as caught:
        read_lumen(path, "mm")
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_mesh_needs_a_unit(tmp_path):
    with pytest.raises(ShapeError, match="give mm or m"):
        read_lumen(tmp_path / "a_lumen.ply", "inch")
