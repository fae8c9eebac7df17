"""Octahedral normals: the compiled twin of gstream/formats/lodrule.py, equal to the bit.

Source: Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors",
JCGT 3(2), 2014; the integer rule is the spec's, "Normals".
"""

from math import floor, sqrt

import numpy as np

from gstream.kernels import kernel

UNIT = 32767.0
ZERO = np.uint64(0)
# Then |x| + |y| + |z| < 2^32, and its products with h < 2^11 are exact in binary64.
SHIFTED_BITS = np.uint64(30)


@kernel
def unfold(x, y, h):
    """The point of the octahedron |x| + |y| + |z| = h above or below a point of its square.

    x, y, h : int   -h to h, and one more for damaged codes
    returns: int, int, int
    errors : none
    source : Cigolle et al., section 4
    """
    z = h - abs(x) - abs(y)
    if z >= 0:
        return x, y, z
    u, v = h - abs(y), h - abs(x)
    return (-u if x < 0 else u), (-v if y < 0 else v), z


@kernel
def decode_normal(field_x, field_y, bits):
    """One direction of about 32767 units.

    field_x, field_y, bits : int
    returns: int, int, int   0, 0, 0 for "no direction"
    errors : none
    source : spec, "Normals"
    """
    h = (1 << (bits - 1)) - 1
    if field_x == 2 * h + 1 and field_y == 2 * h + 1:
        return 0, 0, 0
    x, y, z = unfold(field_x - h, field_y - h, h)
    scale = UNIT / sqrt(float(x * x + y * y + z * z))
    return floor(x * scale + 0.5), floor(y * scale + 0.5), floor(z * scale + 0.5)


@kernel
def magnitude(value):
    """|value| of an int64 as uint64, -2^63 included."""
    return np.uint64(-value) if value < 0 else np.uint64(value)


@kernel
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


@kernel
def nearest_code(x, y, z, h):
    """Of the four canonical codes around a direction, the one at the least angle.

    x, y, z : int64   not all 0, magnitudes below 2^30; h : int
    returns: int, int   code coordinates, -h to h
    errors : none
    source : Cigolle et al., section 4.1 ("precise"), in the spec's order: the score is the exact
             dot product with the octahedron's point, divided once by the point's length
    """
    s = abs(x) + abs(y) + abs(z)
    px, py = x, y
    if z < 0:
        px, py = s - abs(y), s - abs(x)
        if x < 0:
            px = -px
        if y < 0:
            py = -py
    # Exact: a quotient below 2^11 that is no integer is at least 2^-32 away from one. An integer
    # division takes 40 cycles on many processors.
    x0, y0 = floor(float(px * h) / float(s)), floor(float(py * h) / float(s))
    best, best_x, best_y = -np.inf, 0, 0
    for corner in range(4):
        u = min(max(x0 + (corner & 1), -h), h)
        v = min(max(y0 + (corner >> 1), -h), h)
        if abs(u) == h:
            v = abs(v)
        if abs(v) == h:
            u = abs(u)
        a, b, c = unfold(u, v, h)
        score = float(x * a + y * b + z * c) / sqrt(float(a * a + b * b + c * c))
        if score > best:
            best, best_x, best_y = score, u, v
    return best_x, best_y


@kernel
def encode_normal(x, y, z, bits):
    """The code of one direction of any length.

    x, y, z, bits : int64, int
    returns: int, int   the two fields, both 2^bits - 1 for 0, 0, 0
    errors : none
    source : spec, "Normals"
    """
    a, b, c = magnitude(x), magnitude(y), magnitude(z)
    largest = max(a, b, c)
    if largest == ZERO:
        return (1 << bits) - 1, (1 << bits) - 1
    shift = shift_to_fit(largest)
    u, v, w = np.int64(a >> shift), np.int64(b >> shift), np.int64(c >> shift)
    h = (1 << (bits - 1)) - 1
    code_x, code_y = nearest_code(-u if x < 0 else u, -v if y < 0 else v, -w if z < 0 else w, h)
    return code_x + h, code_y + h


@kernel
def encode_normals(sums, bits):
    """Octahedral codes of directions.

    sums   : (n, 3) int64, any length; bits : int   8 to 12
    returns: (n, 2) u16, canonical; "no direction" for 0, 0, 0
    errors : none
    source : spec, "Normals"
    """
    codes = np.empty((sums.shape[0], 2), np.uint16)
    for i in range(sums.shape[0]):
        codes[i, 0], codes[i, 1] = encode_normal(sums[i, 0], sums[i, 1], sums[i, 2], bits)
    return codes


@kernel
def decode_normals(codes, bits):
    """Directions of octahedral codes.

    codes  : (n, 2) u16; bits : int   8 to 12
    returns: (n, 3) int32, about 32767 long; 0, 0, 0 for "no direction"
    errors : none
    source : spec, "Normals"
    """
    directions = np.empty((codes.shape[0], 3), np.int32)
    for i in range(codes.shape[0]):
        x, y, z = decode_normal(np.int64(codes[i, 0]), np.int64(codes[i, 1]), bits)
        directions[i, 0], directions[i, 1], directions[i, 2] = x, y, z
    return directions
