"""Octahedral normals: the compiled twin of gstream/formats/lodrule.py, equal to the bit.

Source: Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors",
JCGT 3(2), 2014; the integer rule is the spec's, "Normals".
"""

from math import copysign, fabs, isnan, sqrt

import numpy as np

from gstream.kernels import kernel, part

UNIT = 32767.0
ZERO = np.uint64(0)
SHIFTED_BITS = np.uint64(30)
HALF, LOW = np.uint32(16), np.uint32(0xFFFF)
BATCH = 256  # directions: 10 KiB of scratch, within any L1 cache


@part
def magnitude(value):
    """|value| of an int64 as uint64, -2^63 included."""
    return np.uint64(-value) if value < 0 else np.uint64(value)


@part
def shift_to_fit(largest):
    """The smallest right shift that brings a uint64 below 2^30, as uint64."""
    rest = largest >> SHIFTED_BITS
    shift = ZERO
    while rest >= np.uint64(256):
        rest >>= np.uint64(8)
        shift += np.uint64(8)
    while rest != ZERO:
        rest >>= np.uint64(1)
        shift += np.uint64(1)
    return shift


@part
def shift_directions(sums, vectors):
    """Scale directions down to magnitudes below 2^30, toward zero; shorter ones stay as they are.

    sums   : (n, 3) int64
    vectors : (3, m >= n) f64, out, integers; never -0.0
    errors : none
    source : spec, "Normals"
    """
    xs, ys, zs = vectors[0], vectors[1], vectors[2]
    longest = ZERO
    for i in range(sums.shape[0]):
        for c in range(3):
            longest |= np.uint64(abs(sums[i, c]))
    if longest >> SHIFTED_BITS == ZERO:  # most often: 7 ns a direction less
        for i in range(sums.shape[0]):
            xs[i], ys[i], zs[i] = float(sums[i, 0]), float(sums[i, 1]), float(sums[i, 2])
        return
    for i in range(sums.shape[0]):
        x, y, z = sums[i, 0], sums[i, 1], sums[i, 2]
        a, b, c = magnitude(x), magnitude(y), magnitude(z)
        shift = shift_to_fit(a | b | c)  # as many bits as the largest of the three
        u, v, w = np.int64(a >> shift), np.int64(b >> shift), np.int64(c >> shift)
        xs[i] = float(-u if x < 0 else u)
        ys[i] = float(-v if y < 0 else v)
        zs[i] = float(-w if z < 0 else w)


@part
def fold_border(u, v, h):
    """The canonical name of a code on the border of the square; h and coordinates as f64."""
    v = fabs(v) if fabs(u) == h else v
    u = fabs(u) if fabs(v) == h else u
    return u, v


@part
def cosine(x, y, z, u, v, h):
    """The cosine, times a length, between a direction and a code.

    x, y, z, u, v, h : f64   integers; direction below 2^30, code coordinates -h to h
    returns: f64   exact dot product with the octahedron's point, divided by that point's length
    errors : none
    source : Cigolle et al., section 4.1 ("precise"), in the spec's order
    """
    # Both names of a code on the border of the square give the same numbers but for signs of zero.
    c = h - fabs(u) - fabs(v)
    a = copysign(h - fabs(v), u) if c < 0.0 else u
    b = copysign(h - fabs(u), v) if c < 0.0 else v
    return (x * a + y * b + z * c) / sqrt(a * a + b * b + c * c)


@part
def nearest_codes(vectors, count, h, codes):
    """Of the four canonical codes around each direction, the first at the least angle.

    All in binary64, so that the loop vectorises (14 ns each, 50 with integers). Every product and
    sum is an integer below 2^53. A quotient below 2^11 that is no integer is 2^-32 or more away
    from one, so that its floor is exact.

    vectors, count, h : (3, m) f64 of shift_directions, int   first of them, f64
    codes  : (2, m) f64   code coordinates, out; nan for 0, 0, 0
    errors : none
    source : Cigolle et al., section 4.1
    """
    xs, ys, zs = vectors[0], vectors[1], vectors[2]
    us, vs = codes[0], codes[1]
    for i in range(count):
        x, y, z = xs[i], ys[i], zs[i]
        s = fabs(x) + fabs(y) + fabs(z)
        px = copysign(s - fabs(y), x) if z < 0.0 else x
        py = copysign(s - fabs(x), y) if z < 0.0 else y
        u0, v0 = np.floor(px * h / s), np.floor(py * h / s)
        u1, v1 = min(u0 + 1.0, h), min(v0 + 1.0, h)
        score_0, score_1 = cosine(x, y, z, u0, v0, h), cosine(x, y, z, u1, v0, h)
        score_2, score_3 = cosine(x, y, z, u0, v1, h), cosine(x, y, z, u1, v1, h)
        u_low = u1 if score_1 > score_0 else u0
        u_high = u1 if score_3 > score_2 else u0
        upper = max(score_2, score_3) > max(score_0, score_1)
        us[i], vs[i] = fold_border(u_high if upper else u_low, v1 if upper else v0, h)


@part
def encode_batch(sums, bits, vectors, found, codes):
    """Octahedral codes of up to BATCH directions.

    sums, bits, codes : (n, 3) int64, int, (n,) u32, out   v << 16 | u, as encode_normals returns
    vectors, found : (3, BATCH), (2, BATCH) f64   scratch
    errors : none
    source : spec, "Normals"
    """
    h = (1 << (bits - 1)) - 1
    none = np.uint32((2 * h + 1) << 16 | (2 * h + 1))
    shift_directions(sums, vectors)
    nearest_codes(vectors, sums.shape[0], float(h), found)
    for i in range(sums.shape[0]):
        u, v = found[0, i], found[1, i]
        code = np.uint32(np.int32(u) + h) | np.uint32(np.int32(v) + h) << HALF
        codes[i] = none if isnan(u) else code


@kernel
def encode_normals(sums, bits):
    """Octahedral codes of directions.

    sums   : (n, 3) int64, any length; bits : int   8 to 12
    returns: (n, 2) u16, canonical; "no direction" for 0, 0, 0
    errors : none
    source : spec, "Normals"
    """
    codes = np.empty(sums.shape[0], np.uint32)
    vectors, found = np.empty((3, BATCH)), np.empty((2, BATCH))
    for begin in range(0, sums.shape[0], BATCH):
        batch = slice(begin, begin + BATCH)
        encode_batch(sums[batch], bits, vectors, found, codes[batch])
    return codes.view(np.uint16).reshape(-1, 2)


@kernel
def decode_normals(codes, bits):
    """Directions of octahedral codes.

    In binary64, without branches, and from planes, so that the loop vectorises: 7 ns each, 18 when
    it takes the codes out of their pairs itself, 24 with integers.

    codes  : (n, 2) u16; bits : int   8 to 12
    returns: (n, 3) int32, about 32767 long; 0, 0, 0 for "no direction"
    errors : none
    source : Cigolle et al., section 4; spec, "Normals"
    """
    h = float((1 << (bits - 1)) - 1)
    us, vs = np.empty(codes.shape[0]), np.empty(codes.shape[0])
    for i in range(codes.shape[0]):
        us[i], vs[i] = float(codes[i, 0]) - h, float(codes[i, 1]) - h
    directions = np.empty((3, codes.shape[0]), np.int32)
    xs, ys, zs = directions[0], directions[1], directions[2]
    for i in range(codes.shape[0]):
        u, v = us[i], vs[i]
        z = h - fabs(u) - fabs(v)
        x = copysign(1.0, u) * (h - fabs(v)) if z < 0.0 else u
        y = copysign(1.0, v) * (h - fabs(u)) if z < 0.0 else v
        scale = UNIT / sqrt(x * x + y * y + z * z)
        scale = 0.0 if u + v == 2.0 * h + 2.0 else scale
        xs[i] = np.int32(np.floor(x * scale + 0.5))
        ys[i] = np.int32(np.floor(y * scale + 0.5))
        zs[i] = np.int32(np.floor(z * scale + 0.5))
    return directions.T


@kernel
def all_canonical(codes, bits):
    """Whether a writer may store all of these codes.

    codes  : (n, 2) u16, C order; bits : int   8 to 12
    returns: bool
    errors : none
    source : spec, "Normals": of two names of a code on the border, the one with positive fields
    """
    h = np.int32((1 << (bits - 1)) - 1)
    wrong = np.int32(0)
    # From whole words and without branches, so that the loop vectorises.
    words = codes.reshape(-1).view(np.uint32)
    for i in range(words.size):
        u, v = np.int32(words[i] & LOW) - h, np.int32(words[i] >> HALF) - h
        mirrored = ((abs(u) == h) & (v < 0)) | ((abs(v) == h) & (u < 0))
        inside = (u <= h) & (v <= h) & (not mirrored)
        wrong |= np.int32(not (inside | ((u == h + 1) & (v == h + 1))))
    return wrong == 0
