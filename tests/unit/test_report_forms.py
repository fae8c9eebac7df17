"""The forms that the report compares with: none is made of straw, and the truth is known."""

from itertools import pairwise

import numpy as np
import pytest

from gstream.kernels import accumulate
from gstream.report.forms import accumulator, attributes, classification, levels
from gstream.report.forms.stand import SNAP_BITS, Stand
from gstream.report.knobs import knobs
from gstream.report.truth.oracle import exact_voxels
from gstream.report.truth.scenes import SCENES

EDGE = 32


def stand(name, edge=EDGE):
    """A scene in the middle of edge^3 voxels."""
    scene = SCENES[name](edge)
    low, high = scene.points.min(axis=0), scene.points.max(axis=0)
    size = float((high - low).max()) * (1 + 2.0**-10) / edge
    return Stand(scene, edge, size, (low + high) / 2 - size * edge / 2)


def errors(results):
    return [next(iter(result.errors.values())) for result in results]


@pytest.mark.parametrize("name", ["torus", "planes", "room"])
def test_the_form_in_float64_finds_every_voxel_and_tie_of_a_small_grid(name):
    """With 12 snap bits all its sums are exact here, so that it costs what floats cost at best."""
    corners = stand(name).corners
    emit = classification.emit_in(np.float64)
    as_floats = classification.seen_from_afar(corners, np.float64)
    _, voxels = classification.classify(emit, as_floats, 0, EDGE)
    exact = exact_voxels(corners / 2.0**SNAP_BITS, "6", (0, 0, 0), (EDGE,) * 3)
    assert voxels[np.lexsort(voxels.T[::-1])].tolist() == exact.tolist()


def test_float32_far_from_the_origin_moves_vertices_by_up_to_half_its_step():
    corners = np.array([[[4096 * 5 + 1] * 3, [4096 * 5 + 3] * 3, [4096 * 5] * 3]])
    found = classification.seen_from_afar(corners, np.float32)
    assert found[0, :, 0].tolist() == [5.0, 5.0 + 2.0**-10, 5.0]  # steps of 2^-10 from 8192 on


def test_sums_in_fixed_point_keep_every_bit_backwards_and_those_in_float32_do_not():
    fragments = accumulator.emitted(stand("torus"))
    backwards = tuple(a[::-1].copy() for a in fragments[:5]) + fragments[5:]
    voxels = len(np.unique(fragments[0]))
    for form, number, alike in (
        (accumulate.accumulate, np.int64, True),
        (accumulator.accumulate_in(np.float32), np.float32, False),
    ):
        one, other = (
            accumulator.attributes(*accumulator.added(form, number, way, voxels))
            for way in (fragments, backwards)
        )
        assert np.array_equal(one, other) == alike


def test_a_bit_of_colour_more_halves_the_error():
    results = attributes.colour_bits(stand("planes", 128))
    assert [result.value for result in results[:5]] == [4, 5, 6, 7, 8]
    assert all(1.8 < a / b < 2.2 for a, b in pairwise(errors(results)[:5]))


def test_no_threshold_loses_no_face_and_more_loses_more():
    found = errors(attributes.faces(stand("planes")))
    assert found[0] == 0
    assert found == sorted(found)
    assert found[-1] < 0.2  # no component that is lost is larger than the threshold


def test_levels_by_area_are_nearer_to_the_mesh_than_levels_by_count():
    count, area, never_rounded = errors(levels.lod_weight(stand("sphere", 128)))
    assert never_rounded <= area < count


def test_a_scene_of_large_triangles_or_without_colour_has_no_such_form():
    assert levels.lod_weight(stand("room")) == []
    assert attributes.colour_bits(stand("sphere")) == []


def test_over_14_levels_codes_of_more_bits_drift_less_and_one_rounding_least():
    *coded, once = errors(levels.lod_codes(stand("planes")))
    assert coded == sorted(coded, reverse=True)
    assert once < coded[-1]
    assert coded[-1] < 0.1  # degrees, with 12 bits


@pytest.mark.parametrize("measure", [attributes.faces, levels.lod_codes, levels.lod_weight])
def test_the_values_measured_are_those_of_a_knob(measure):
    known = {knob.values for knob in knobs(EDGE)}
    assert tuple(result.value for result in measure(stand("sphere"))) in known
