"""Areas of triangles larger than a packet's box: walked and in closed form, against clipping."""

import numpy as np
from hypothesis import assume, example, given
from hypothesis import strategies as st

from gstream.kernels.voxelize import voxelize_triangles

EDGE = 64
UNIT_AREA = 2**26


@st.composite
def corners(draw):
    """Snap bits, and a triangle of up to EDGE voxels with corners often between voxels."""
    k = draw(st.integers(1, 20))
    extent = draw(st.sampled_from([4, 9, 12, 16, 30, EDGE - 1]))
    place = st.one_of(
        st.integers(0, extent << k), st.integers(0, extent).map(lambda voxel: voxel << k)
    )
    return k, draw(st.tuples(*[st.tuples(place, place, place)] * 3))


def found(triangle, snap_bits, sep, channels):
    """The voxels of one triangle; channels are clipped, without them areas are walked."""
    values = np.full((1, 3, channels), 0.5)
    vertices = np.array([triangle], np.int64)
    return voxelize_triangles(vertices, snap_bits, (0, 0, 0), EDGE, sep, "one-sided", values)


@given(corners(), st.sampled_from(["conservative", "6", "26"]))
@example((4, ((0, 0, 0), (16 * 16, 0, 3), (0, 15 * 16, 240))), "6")
@example((20, ((1, 1, 1), ((63 << 20) - 1, 5, 9), (7, (63 << 20) - 3, 1 << 20))), "6")
def test_voxels_and_areas_do_not_depend_on_how_areas_are_made(drawn, sep):
    snap_bits, triangle = drawn
    walked, clipped = (found(triangle, snap_bits, sep, channels) for channels in (0, 1))
    assert np.array_equal(walked.voxel, clipped.voxel)
    assert np.array_equal(walked.hit, clipped.hit)
    assert np.abs(walked.area - clipped.area).max(initial=0) <= 1


@given(corners())
def test_the_areas_of_a_triangle_sum_to_its_area(drawn):
    snap_bits, triangle = drawn
    a, b, c = np.array(triangle, float) / (1 << snap_bits)
    area = np.linalg.norm(np.cross(b - a, c - a)) / 2
    assume(area > 0)
    voxels = found(triangle, snap_bits, "conservative", 0)
    # Each fragment is rounded, and has at least one unit.
    assert abs(voxels.area.sum() / UNIT_AREA - area) <= 1e-9 * area + voxels.fragments / UNIT_AREA
