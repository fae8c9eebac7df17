"""What functions of the shaders compute is what a twin in NumPy does."""

import moderngl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gstream_tools.reader_py.columns import unit_normals
from gstream_tools.view_gl import programs

VOXELS = 200
PLACES = arrays(np.int32, (VOXELS, 3), elements=st.integers(-40, 40))


def computed(context, parts, defines, rows, kind, made, uniforms):
    """What an expression gives for each row of 32-bit words: (n, 1) u4 or, of a vec3, (n, 3) f4.

    kind : uint or vec3
    made : GLSL, of `word(i)`, the row's words as uint, and `number(i)`, as float
    """
    width = 3 if kind == "vec3" else 1
    source = f"""{programs._source(parts, defines)}
        layout(local_size_x = 1) in;
        layout(std430, binding = 0) readonly buffer Given {{ uint given[]; }};
        layout(std430, binding = 1) writeonly buffer Made {{ uint made[]; }};
        uint word(int i) {{ return given[gl_WorkGroupID.x * {rows.shape[1]} + i]; }}
        float number(int i) {{ return uintBitsToFloat(word(i)); }}
        void main() {{
            {kind} value = {made};
            for (int i = 0; i < {width}; i++)
                made[gl_WorkGroupID.x * {width} + i]
                    = {"floatBitsToUint(value[i])" if width == 3 else "value"};
        }}"""
    shader = context.compute_shader(source)
    for name, value in uniforms.items():
        if name in shader:
            shader[name] = value
    given = context.buffer(np.ascontiguousarray(rows).tobytes())
    result = context.buffer(reserve=4 * width * len(rows))
    given.bind_to_storage_buffer(0)
    result.bind_to_storage_buffer(1)
    shader.run(len(rows))
    context.memory_barrier(moderngl.ALL_BARRIER_BITS)
    return np.frombuffer(result.read(), np.uint32 if width == 1 else np.float32).reshape(-1, width)


def facing(low, edge, eye, parallel):
    """Bits -x +x -y +y -z +z of the faces in front of which the eye is."""
    near, far = (0 * low, 0 * low) if parallel else (low, low + edge[:, None])
    bits = np.stack([eye < near, eye > far], axis=2).reshape(-1, 6)
    return (bits << np.arange(6)).sum(axis=1)


@given(
    low=PLACES,
    log2=st.integers(0, 4),
    # On lattice points too, where the eye is in the plane of faces, and in voxels.
    eye=st.tuples(*[st.one_of(st.integers(-50, 50), st.floats(-50, 50, width=32))] * 3),
    parallel=st.booleans(),
)
def test_the_faces_shown_are_those_before_which_the_eye_is_and_at_most_three(
    context, low, log2, eye, parallel
):
    edge = np.full(VOXELS, 1 << log2, np.int32)
    faces = computed(
        context, ("common",), {}, np.column_stack([low, edge]),
        "uint", "facing(ivec3(word(0), word(1), word(2)), int(word(3)))",
        {"eye": eye, "parallel": parallel},
    )[:, 0]  # fmt: skip
    assert np.array_equal(faces, facing(low, edge, np.array(eye), parallel))
    assert np.bitwise_count(faces).max() <= 3
    inside = ((low < eye) & (np.array(eye) < low + edge[:, None])).all(axis=1)
    assert parallel or not faces[inside].any()


@pytest.mark.parametrize("bits", [8, 11, 16])
def test_normals_are_the_reader_s(context, bits):
    rng = np.random.default_rng(bits)
    codes = rng.integers(0, (1 << bits) - 1, (5000, 2)).astype(np.uint16)
    half = (1 << bits - 1) - 1
    codes[:6] = [[half, half], [0, half], [half, 0], [0, 0], [2 * half, 0], [2 * half + 1] * 2]
    words = codes[:, 0].astype(np.uint32) | codes[:, 1].astype(np.uint32) << 16
    normals = computed(
        context, ("common", "srgb", "shade"), {"LIT": 1, "LIGHTS": 1}, words[:, None],
        "vec3", "unit_normal(word(0))", {"normal_bits": bits},
    )  # fmt: skip
    assert np.abs(normals - unit_normals(codes, bits)).max() < 1e-6


def test_srgb_codes_are_those_of_the_standard_and_come_back(context):
    """IEC 61966-2-1, 5.2 and 5.3."""
    codes = (np.arange(256) / 255).astype(np.float32)
    colours = np.repeat(codes[:, None], 3, axis=1)
    colour = "(vec3(number(0), number(1), number(2)))"
    linear = computed(context, ("srgb",), {}, colours, "vec3", f"decoded{colour}", {})
    low = codes <= 0.04045
    expected = np.where(low, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    assert np.abs(linear - expected[:, None]).max() < 1e-6
    back = computed(context, ("srgb",), {}, linear, "vec3", f"encoded{colour}", {})
    assert np.array_equal(np.rint(back * 255), np.rint(colours * 255))
