"""Slow twins of the kernels, in plain Python integers, to be read beside the spec.

Nothing here shares code or tables with gstream. Binary64 appears only where the spec says so.
"""

from fractions import Fraction
from math import floor, sqrt


def morton(x, y, z):
    """Interleave the bits of three coordinates, x lowest."""
    code = 0
    for bit in range(max(x, y, z).bit_length()):
        for axis, value in enumerate((x, y, z)):
            code |= (value >> bit & 1) << (3 * bit + axis)
    return code


def coordinates(code):
    """Undo morton."""
    point = [0, 0, 0]
    for bit in range(code.bit_length()):
        point[bit % 3] |= (code >> bit & 1) << (bit // 3)
    return tuple(point)


def octree_masks(codes, log2_edge):
    """Child masks breadth-first from the root, as a list of ints."""
    masks = []
    for level in range(log2_edge):
        nodes = sorted({code >> 3 * (log2_edge - level) for code in codes})
        children = {code >> 3 * (log2_edge - level - 1) for code in codes}
        masks += [sum(1 << c for c in range(8) if node * 8 + c in children) for node in nodes]
    return masks


def octree_leaves(masks, log2_edge):
    """Undo octree_masks; None where the masks are no tree."""
    queue, at = [0], 0
    for _ in range(log2_edge):
        children = []
        for node in queue:
            if at == len(masks) or masks[at] == 0:
                return None
            children += [node * 8 + c for c in range(8) if masks[at] >> c & 1]
            at += 1
        queue = children
    return queue if at == len(masks) else None


def apply_filter(filter_id, rows, item_bytes, bits):
    """Filter rows of component values into bytes, as the spec numbers the filters."""
    columns = [list(column) for column in zip(*rows, strict=True)]
    modulus = 1 << bits
    if filter_id == 0:
        return b"".join(v.to_bytes(item_bytes, "little") for column in columns for v in column)
    if filter_id == 1:
        return bytes(
            v >> 8 * q & 255 for column in columns for q in range(item_bytes) for v in column
        )
    if filter_id == 5:
        red, green, blue, alpha = columns
        red = [(r - g) % 256 for r, g in zip(red, green, strict=True)]
        blue = [(b - g) % 256 for b, g in zip(blue, green, strict=True)]
        columns = [green, red, blue, alpha]
    if filter_id in (3, 5):
        columns = [
            [_zigzag((v - w) % modulus, bits) for v, w in zip(column, [0, *column], strict=False)]
            for column in columns
        ]
    if filter_id == 4:
        columns = [[v ^ w for v, w in zip(c, [0, *c], strict=False)] for c in columns]
    return b"".join(_plane(column, p) for column in columns for p in range(bits))


def _zigzag(difference, bits):
    signed = difference - (1 << bits) if difference >> (bits - 1) else difference
    return (2 * signed if signed >= 0 else -2 * signed - 1) % (1 << bits)


def _plane(column, plane):
    data = bytearray((len(column) + 7) // 8)
    for i, value in enumerate(column):
        data[i // 8] |= (value >> plane & 1) << (i % 8)
    return bytes(data)


def _sign(value):
    return -1 if value < 0 else 1


def _unfold(x, y, h):
    z = h - abs(x) - abs(y)
    if z < 0:
        x, y = (h - abs(y)) * _sign(x), (h - abs(x)) * _sign(y)
    return x, y, z


def _canonical(x, y, h):
    if abs(x) == h:
        y = abs(y)
    if abs(y) == h:
        x = abs(x)
    return x, y


def decode_normal(field_x, field_y, bits):
    """The direction of a code, about 32767 long."""
    h = 2 ** (bits - 1) - 1
    if field_x == field_y == 2**bits - 1:
        return 0, 0, 0
    point = _unfold(field_x - h, field_y - h, h)
    scale = 32767.0 / sqrt(sum(c * c for c in point))
    return tuple(floor(c * scale + 0.5) for c in point)


def encode_normal(x, y, z, bits):
    """The code of a direction."""
    h = 2 ** (bits - 1) - 1
    largest = max(abs(x), abs(y), abs(z))
    if largest == 0:
        return 2**bits - 1, 2**bits - 1
    shift = max(0, largest.bit_length() - 30)
    x, y, z = (_sign(c) * (abs(c) >> shift) for c in (x, y, z))
    s = abs(x) + abs(y) + abs(z)
    px, py = x, y
    if z < 0:
        px, py = (s - abs(y)) * _sign(x), (s - abs(x)) * _sign(y)
    x0, y0 = px * h // s, py * h // s
    best = None
    for u, v in ((x0, y0), (x0 + 1, y0), (x0, y0 + 1), (x0 + 1, y0 + 1)):
        u, v = _canonical(min(max(u, -h), h), min(max(v, -h), h), h)
        a, b, c = _unfold(u, v, h)
        score = float(x * a + y * b + z * c) / sqrt(float(a * a + b * b + c * c))
        if best is None or score > best[0]:
            best = score, u + h, v + h
    return best[1:]


def linear_of_code(code):
    """floor(65535 * linear + 1/2) of an sRGB code, by the formula of IEC 61966-2-1."""
    c = code / 255
    linear = c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
    return floor(65535 * linear + 0.5)


LINEAR = [linear_of_code(code) for code in range(256)]


def code_of_linear(value):
    """The largest code whose lower half-way point does not exceed the value."""
    code = 0
    for c in range(1, 256):
        if value >= (LINEAR[c - 1] + LINEAR[c] + 1) // 2:
            code = c
    return code


def round_half_up(value):
    """Round an exact fraction."""
    return floor(value + Fraction(1, 2))


def mean_colour(colours, weights):
    """Weighted mean of RGBA colours, R, G, B in linear light."""
    total = sum(weights)
    mean = []
    for component in range(4):
        values = [colour[component] for colour in colours]
        if component < 3:
            values = [LINEAR[v] for v in values]
        exact = Fraction(sum(w * v for w, v in zip(weights, values, strict=True)), total)
        mean.append(round_half_up(exact))
    return (*(code_of_linear(v) for v in mean[:3]), mean[3])


def reduce_runs(voxels, bits, use_weight):
    """Parents of (code, mask, normal, colour, weight) tuples, as a list of the same tuples."""
    parents = {}
    for voxel in voxels:
        parents.setdefault(voxel[0] >> 3, []).append(voxel)
    reduced = []
    for code, children in sorted(parents.items()):
        weights = [child[4] if use_weight else 1 for child in children]
        mask = 0
        direction = [0, 0, 0]
        for child, weight in zip(children, weights, strict=True):
            mask |= child[1]
            for axis, d in enumerate(decode_normal(*child[2], bits)):
                direction[axis] += weight * d
        weight = min(max(1, (sum(child[4] for child in children) + 2) // 4), 2**32 - 1)
        colour = mean_colour([child[3] for child in children], weights)
        reduced.append((code, mask or 63, encode_normal(*direction, bits), colour, weight))
    return reduced


def finish_voxel(area, area_vector, colour_sum, mask, bits):
    """(mask, normal, colour, weight) of one voxel of level 0."""
    means = [round_half_up(Fraction(s, max(area, 1))) for s in colour_sum]
    colour = (*(code_of_linear(v) for v in means[:3]), means[3])
    weight = min(max(1, (area + 32) // 64), 2**32 - 1)
    return mask or 63, encode_normal(*area_vector, bits), colour, weight
