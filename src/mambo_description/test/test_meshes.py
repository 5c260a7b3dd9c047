"""The meshes are closed surfaces of the right size, and those in the folder are these."""

from collections import Counter

from mambo_description import meshes
import numpy as np
import pytest


def read(data):
    """Return normals and corners of a binary STL file."""
    count = int(np.frombuffer(data, '<u4', 1, 80)[0])
    rows = np.frombuffer(data, [('n', '<f4', 3), ('c', '<f4', (3, 3)), ('a', '<u2')], count, 84)
    assert len(data) == 84 + 50 * count
    return rows['n'], rows['c']


@pytest.mark.parametrize('name', meshes.MESHES)
def test_the_file_that_is_shipped_is_the_one_that_is_made(name):
    file = meshes.FOLDER / name
    shipped, made = read(file.read_bytes()), read(meshes.stl(meshes.MESHES[name]()))
    for a, b in zip(shipped, made):
        np.testing.assert_allclose(a, b, atol=1e-6)
    assert file.stat().st_size < 30_000


@pytest.mark.parametrize('make', [
    lambda: meshes.box((1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 0.4, 0.5),
    lambda: meshes.cylinder(1.0, 2.0)], ids=['box', 'cylinder'])
def test_a_part_is_closed_and_looks_outwards(make):
    triangles = make()
    edges = Counter()
    for a, b, c in np.round(triangles, 9).tolist():
        edges.update((tuple(p), tuple(q)) for p, q in ((a, b), (b, c), (c, a)))
    assert all(edges[q, p] == 1 == count for (p, q), count in edges.items())
    a, b, c = triangles.transpose(1, 0, 2)
    volume = np.einsum('ij,ij->', a, np.cross(b, c)) / 6.0
    assert volume == pytest.approx(6.0 if len(triangles) == 12 else 2 * np.pi, rel=0.03)


def test_the_body_is_as_wide_as_a_mambo_and_a_rotor_has_radius_one():
    corners = meshes.body().reshape(-1, 3)
    assert np.ptp(corners[:, 1]) == pytest.approx(2 * (meshes.ARM + 0.006), rel=0.02)
    assert np.abs(meshes.rotor().reshape(-1, 3)[:, 0]).max() == pytest.approx(1.0, abs=0.01)


def test_the_script_writes_them(tmp_path, monkeypatch):
    monkeypatch.setattr('sys.argv', ['meshes', str(tmp_path / 'new')])
    meshes.main()
    assert {file.name for file in (tmp_path / 'new').iterdir()} == set(meshes.MESHES)
