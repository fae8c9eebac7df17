"""Hypothesis strategies that several test files share."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

NORMAL_BITS = range(8, 13)

LOG2_EDGES = st.integers(3, 8)


@st.composite
def voxel_sets(draw, max_voxels=60):
    """(log2_edge, ascending unique local Morton codes as u32)."""
    log2_edge = draw(LOG2_EDGES)
    last = 8**log2_edge - 1
    codes = draw(st.sets(st.integers(0, last), min_size=1, max_size=max_voxels))
    near = draw(st.integers(0, last))
    codes |= {min(near + step, last) for step in range(draw(st.integers(0, 20)))}
    return log2_edge, np.array(sorted(codes), np.uint32)


@st.composite
def columns(draw, max_voxels=40):
    """(values (n, components), bits): a column of one of the types that the block file has."""
    dtype, components, bits = draw(
        st.sampled_from(
            [
                (np.uint8, 1, 6),
                (np.uint8, 1, 8),
                (np.uint8, 4, 8),
                (np.uint32, 1, 32),
                *((np.uint16, 2, b) for b in NORMAL_BITS),
            ]
        )
    )
    count = draw(st.integers(1, max_voxels))
    elements = st.one_of(
        st.integers(0, (1 << bits) - 1), st.sampled_from([0, 1, (1 << bits) - 1, 1 << (bits - 1)])
    )
    return draw(hnp.arrays(dtype, (count, components), elements=elements)), bits


@st.composite
def directions(draw):
    """An int64 vector: any length, axis-aligned, diagonal, tiny or huge."""
    scale = draw(st.integers(0, 62))
    component = st.one_of(
        st.integers(-(1 << scale), 1 << scale),
        st.sampled_from([0, 1, -1, 1 << scale, -(1 << scale), -(1 << 63), (1 << 63) - 1]),
    )
    return draw(st.tuples(component, component, component))


@st.composite
def normal_codes(draw, bits):
    """The two fields of a canonical code, or "no direction"."""
    h = (1 << (bits - 1)) - 1
    x, y = draw(st.tuples(st.integers(-h, h), st.integers(-h, h)))
    if draw(st.integers(0, 9)) == 0:
        return (1 << bits) - 1, (1 << bits) - 1
    if abs(x) == h:
        y = abs(y)
    if abs(y) == h:
        x = abs(x)
    return x + h, y + h


@st.composite
def sibling_voxels(draw, bits, max_voxels=30):
    """Voxels of eight sibling blocks: (code, mask, normal, colour, weight), ascending codes."""
    codes = draw(st.sets(st.integers(0, 8**3 - 1), min_size=1, max_size=max_voxels))
    voxels = []
    for code in sorted(codes):
        mask = draw(st.integers(0, 63))
        normal = draw(normal_codes(bits))
        colour = draw(st.tuples(*[st.integers(0, 255)] * 4))
        weight = draw(st.one_of(st.integers(1, 1 << 21), st.sampled_from([1, (1 << 32) - 1])))
        voxels.append((code, mask, normal, colour, weight))
    return voxels
