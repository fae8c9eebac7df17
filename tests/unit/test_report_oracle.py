"""The report's exact voxels, against the rational oracle of the exact tests and by hand."""

from random import Random

import numpy as np
import pytest
from exact import scenes
from exact.oracle import SEPARATIONS, voxels_of

from gstream.report.truth import oracle
from gstream.report.truth.oracle import exact_voxels

LOW, HIGH = (0, 0, 0), (8, 8, 8)


def by_rationals(triangles, bits):
    found = {sep: set() for sep in SEPARATIONS}
    for triangle in triangles:
        for sep, voxels in voxels_of(triangle, bits, LOW, 8, "one-sided").items():
            found[sep] |= voxels
    return found


def by_report(corners, sep, low=LOW, high=HIGH):
    return set(map(tuple, exact_voxels(np.asarray(corners, float), sep, low, high).tolist()))


def assert_equal_sets(triangles, bits):
    for sep, expected in by_rationals(triangles, bits).items():
        assert by_report(triangles / 2.0**bits, sep) == expected, sep


@pytest.mark.parametrize("kind", scenes.KINDS)
@pytest.mark.parametrize("bits", [2, 12])
def test_a_soup_s_voxels_are_the_rational_oracle_s(kind, bits):
    assert_equal_sets(scenes.soup(kind, 1, 8, bits, LOW, 8), bits)


@pytest.mark.parametrize("corner", [(1, 2, 3), (2, 4, 5), (3, 1, 2)], ids=str)
def test_a_box_on_lattice_and_half_planes_has_the_rational_oracle_s_voxels(corner):
    assert_equal_sets(scenes.box(corner, (10, 12, 13)), 1)


@pytest.mark.parametrize("bits", [17, 19, 21, 24, 36])
def test_ties_missed_by_a_last_bit_are_decided_as_in_rationals(bits):
    # a normal's products, of three times as many bits, are about and far beyond int64's 63
    random = Random(bits)
    kinds = ("coplanar", "lattice", "tie plane")
    soup = np.concatenate([scenes.soup(kind, 2, 6, 2, LOW, 8) for kind in kinds]) << (bits - 2)
    off = [random.choice([-1, 0, 0, 0, 1]) for _ in range(soup.size)]
    assert_equal_sets(soup + np.array(off).reshape(soup.shape), bits)


@pytest.mark.parametrize("sep", SEPARATIONS)
def test_float64_decides_nothing_that_integers_decide_otherwise(sep, monkeypatch):
    random = np.random.default_rng(7)
    kinds = ("generic", "lattice", "tie plane", "edge on a diagonal", "needle")
    soup = np.concatenate([scenes.soup(kind, 5, 30, 2, LOW, 8) / 4 for kind in kinds])
    for way in (-np.inf, np.inf):  # a third goes down by a last bit, a third up
        soup = np.where(random.random(soup.shape) < 1 / 3, np.nextafter(soup, way), soup)
    soup[np.abs(soup) < 2.0**-200] = 0.0
    found = [by_report(soup[i : i + 1], sep) for i in range(len(soup))]
    monkeypatch.setattr(oracle, "ERROR", 1e9)  # above every value: integers decide all
    assert [by_report(soup[i : i + 1], sep) for i in range(len(soup))] == found


@pytest.mark.parametrize("sep", SEPARATIONS)
def test_a_large_triangle_has_the_voxels_of_its_parts(sep):
    triangle = np.array([[[3, 5, 2], [163, 40, 73], [37, 140, 152]]]) << 4
    parts = scenes.subdivided(triangle, 4)
    bounds = (0, 0, 0), (170, 170, 170)
    assert by_report(triangle / 16, sep, *bounds) == by_report(parts / 16, sep, *bounds)


def test_a_face_between_two_layers_sets_the_upper_one():
    face = [[[0, 0, 3], [8, 0, 3], [0, 8, 3]], [[8, 0, 3], [8, 8, 3], [0, 8, 3]]]
    layer = {(x, y, 3) for x in range(8) for y in range(8)}
    for sep in SEPARATIONS:
        assert by_report(face, sep) == layer


@pytest.mark.parametrize("end", [1.75, 1.25], ids=["a line", "a point"])
@pytest.mark.parametrize(("height", "layer"), [(2.5, 2), (2.0, 2), (3.0, 3)])
def test_a_triangle_without_area_meets_a_voxel_and_no_segment(end, height, layer):
    triangle = [[[1.25, 1.5, height], [end, 1.5, height], [1.25, 1.5, height]]]
    assert by_report(triangle, "conservative") == {(1, 1, layer)}
    assert by_report(triangle, "6") == by_report(triangle, "26") == set()


def test_only_voxels_asked_for_are_found():
    triangle = [[[-50, -50, 2.3], [90, -50, 2.3], [-50, 90, 2.3]]]
    assert by_report(triangle, "6", (2, 3, 0), (4, 4, 9)) == {(2, 3, 2), (3, 3, 2)}
    assert by_report(triangle, "6", (2, 3, 3), (4, 4, 9)) == set()


def test_voxels_are_sorted_and_each_stands_once():
    corners = np.random.default_rng(3).uniform(0, 8, (40, 3, 3))
    found = exact_voxels(corners, "conservative", LOW, HIGH)
    np.testing.assert_array_equal(found, np.unique(found, axis=0))
    assert exact_voxels(corners[:0], "6", LOW, HIGH).shape == (0, 3)
