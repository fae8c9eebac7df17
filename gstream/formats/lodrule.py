"""The normative rules of normals, colours and levels of detail, in plain NumPy.

The compiled twins are kernels/octahedral.py and kernels/lod.py; `check` uses this module. Every
result is fixed to the bit: integers, and IEEE binary64 in the stated order. Sources: Cigolle et
al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 3(2), 2014
(octahedral, best of four); IEC 61966-2-1 (sRGB).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
U32 = NDArray[np.uint32]
I64 = NDArray[np.int64]

UNIT: Final = 32767.0  # length of a decoded normal
MAX_WEIGHT: Final = (1 << 32) - 1

# floor(65535 * linear(c / 255) + 1/2) for c = 0...255, big-endian, checked with 60-digit decimals.
_LINEAR_HEX: Final = (
    "000000140028003c005000630077008b009f00b300c700db00f1010801200139"
    "0154016f018c01ab01ca01eb020e02320257027d02a502ce02f9032503530382"
    "03b303e50418044d048404bc04f60532056f05ad05ed062f067306b806fe0747"
    "079107dd082a087a08ca091d097209c80a200a790ad50b320b910bf20c550cba"
    "0d200d880df20e5e0ecc0f3c0fae10211097110e118812031280130013811404"
    "14891510159a162516b2174117d3186618fb19931a2c1ac81b661c061ca71d4c"
    "1df21e9a1f441ff120a02150220422b92370242a24e525a32664272627eb28b1"
    "297b2a462b142be32cb62d8a2e612f3a301530f231d232b43399348035693655"
    "3742383339253a1a3b123c0b3d073e063f07400a4110421843234430453f4651"
    "4765487c49954ab14bcf4cf04e134f395061518c52b953e9551b5650578758c1"
    "59fe5b3d5c7e5dc25f096052619e62ed643e659166e86840699c6afa6c5b6dbe"
    "6f24708d71f8736674d7764a77c079397ab47c327db37f3780bd824683d1855f"
    "86f088848a1b8bb48d508eef9090923593dc9586973298e29a949c499e019fbb"
    "a179a339a4fca6c2a88baa56ac25adf6afcab1a1b37bb557b737b919baffbce7"
    "bed2c0c0c2b1c4a5c69cc895ca92cc91ce94d099d2a1d4add6bbd8ccdae0dcf7"
    "df11e12ee34ee571e797e9c0ebecee1bf04df282f4baf6f5f933fb74fdb8ffff"
)
LINEAR_OF_CODE: Final[U16] = np.frombuffer(bytes.fromhex(_LINEAR_HEX), ">u2").astype(np.uint16)


def _codes_of_linear() -> U8:
    """The largest code c with c = 0 or v >= (T[c-1] + T[c] + 1) // 2, for v = 0...65535."""
    table = LINEAR_OF_CODE.astype(np.int64)
    thresholds = (table[:-1] + table[1:] + 1) // 2
    return np.searchsorted(thresholds, np.arange(65_536), side="right").astype(np.uint8)


CODE_OF_LINEAR: Final[U8] = _codes_of_linear()
COLOUR_TABLES: Final = (LINEAR_OF_CODE, CODE_OF_LINEAR)  # as the kernels want them


def no_direction(bits: int) -> int:
    """Both fields of the code that stands for "no direction"."""
    return (1 << bits) - 1


def decode_normals(codes: U16, bits: int) -> NDArray[np.int32]:
    """Directions of octahedral codes.

    codes  : (n, 2) u16, fields x + h and y + h of `bits` bits, h = 2^(bits-1) - 1
    returns: (n, 3) int32, about 32767 long; 0, 0, 0 for "no direction"
    """
    h = (1 << (bits - 1)) - 1
    fields = codes.astype(np.int64)
    point = _unfold(fields[:, 0] - h, fields[:, 1] - h, h)
    scale = UNIT / np.sqrt((point * point).sum(axis=1).astype(np.float64))
    directions: NDArray[np.int32] = np.floor(point * scale[:, None] + 0.5).astype(np.int32)
    directions[(fields == no_direction(bits)).all(axis=1)] = 0
    return directions


def unit_vectors(directions: NDArray[np.generic]) -> NDArray[np.float32]:
    """(n, 3) vectors of length 1 along the given ones; 0, 0, 0 stays."""
    vectors = directions.astype(np.float64)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: NDArray[np.float64] = vectors / np.where(length > 0, length, 1.0)
    return unit.astype(np.float32)


def encode_normals(sums: I64, bits: int) -> U16:
    """Octahedral codes of directions: of the four codes around each, the one at the least angle.

    sums   : (n, 3) int64 of any length, -2^63 included
    returns: (n, 2) u16, canonical; "no direction" for 0, 0, 0
    """
    h = (1 << (bits - 1)) - 1
    magnitudes = np.abs(sums).view(np.uint64)
    largest = magnitudes.max(axis=1)
    shift = np.zeros(len(sums), np.uint64)
    for step in (32, 16, 8, 4, 2, 1):  # the smallest shift that brings the largest below 2^30
        high = (largest >> shift) >> np.uint64(29 + step) != 0
        shift[high] += np.uint64(step)
    shift[(largest >> shift) >> np.uint64(30) != 0] += np.uint64(1)
    vectors = (magnitudes >> shift[:, None]).astype(np.int64)
    vectors[sums < 0] *= -1
    x, y, z = vectors.T
    s = np.maximum(np.abs(vectors).sum(axis=1), 1)
    lower = z < 0
    px = np.where(lower, (s - np.abs(y)) * _sign(x), x)
    py = np.where(lower, (s - np.abs(x)) * _sign(y), y)
    x0, y0 = px * h // s, py * h // s
    best = np.full(len(sums), -np.inf)
    codes = np.full((len(sums), 2), no_direction(bits), np.uint16)
    for step_x, step_y in ((0, 0), (1, 0), (0, 1), (1, 1)):
        u, v = _canonical(np.clip(x0 + step_x, -h, h), np.clip(y0 + step_y, -h, h), h)
        point = _unfold(u, v, h)
        length = np.sqrt((point * point).sum(axis=1).astype(np.float64))
        score = (vectors * point).sum(axis=1).astype(np.float64) / length
        better = (score > best) & (largest != 0)
        best[better] = score[better]
        codes[better, 0] = (u + h)[better]
        codes[better, 1] = (v + h)[better]
    return codes


def canonical_normals(codes: U16, bits: int) -> NDArray[np.bool_]:
    """Which codes a writer may store: (n,) bool for (n, 2) codes."""
    h = (1 << (bits - 1)) - 1
    fields = codes.astype(np.int64)
    u, v = _canonical(fields[:, 0] - h, fields[:, 1] - h, h)
    inside = (fields <= 2 * h).all(axis=1) & (u + h == fields[:, 0]) & (v + h == fields[:, 1])
    lawful: NDArray[np.bool_] = inside | (fields == no_direction(bits)).all(axis=1)
    return lawful


def all_canonical(codes: U16, bits: int) -> bool:
    """Whether a writer may store all of these (n, 2) codes."""
    return bool(canonical_normals(codes, bits).all())


def _sign(values: I64) -> I64:
    return np.where(values < 0, -1, 1)


def _canonical(x: I64, y: I64, h: int) -> tuple[I64, I64]:
    """A border point and its mirror image are one direction; the positive one is its name."""
    v = np.where(np.abs(x) == h, np.abs(y), y)
    return np.where(np.abs(v) == h, np.abs(x), x), v


def _unfold(x: I64, y: I64, h: int) -> I64:
    z = h - np.abs(x) - np.abs(y)
    lower = z < 0
    u = np.where(lower, (h - np.abs(y)) * _sign(x), x)
    v = np.where(lower, (h - np.abs(x)) * _sign(y), y)
    return np.stack((u, v, z), axis=1)


def rounded_mean(sums: I64, weights: I64) -> I64:
    """sums / weights rounded half up, for sums >= 0 and weights >= 1; no product overflows."""
    quotient, rest = np.divmod(sums, weights)
    return quotient + (rest >= weights - rest)


@dataclass(frozen=True, slots=True)
class Reduced:
    """The parent voxels that reduce_runs makes; absent columns have length 0."""

    morton: NDArray[np.unsignedinteger]  # (m,) ascending codes in the parent block, u32 or u64
    mask: U8  # (m,)
    normal: U16  # (m, 2)
    colour: U8  # (m, 4)
    weight: U32  # (m,)


def reduce_runs(
    codes: NDArray[np.unsignedinteger],
    mask: U8,
    normal: U16,
    colour: U8,
    weight: U32,
    normal_bits: int,
    use_weight: bool,
) -> Reduced:
    """Merge the voxels of up to eight sibling blocks two by two by two.

    codes  : (n,) u32 or u64, ascending; octant of the block << 3 log2_edge | local code
    normal : (n, 2), colour (n, 4), weight (n,): length 0 where the column is absent
    use_weight : average by weight (area); otherwise every child counts 1
    returns: the parent block's voxels; weight is (sum w + 2) // 4 whatever the averages use
    """
    parents = codes >> codes.dtype.type(3)
    first = np.flatnonzero(np.concatenate(([True], parents[1:] != parents[:-1])))
    shares = np.ones(len(codes), np.int64)
    if use_weight and len(weight):
        shares = weight.astype(np.int64)
    totals = np.add.reduceat(shares, first)
    merged_mask = np.bitwise_or.reduceat(mask, first)
    merged_mask[merged_mask == 0] = 63
    parts: dict[str, NDArray[np.unsignedinteger]] = {"normal": normal, "colour": colour}
    if len(normal):
        directions = decode_normals(normal, normal_bits) * shares[:, None]
        parts["normal"] = encode_normals(np.add.reduceat(directions, first), normal_bits)
    if len(colour):
        linear = colour.astype(np.int64)
        linear[:, :3] = LINEAR_OF_CODE[colour[:, :3]]
        means = rounded_mean(np.add.reduceat(linear * shares[:, None], first), totals[:, None])
        parts["colour"] = colour_codes(means)
    merged_weight = weight
    if len(weight):
        sums = np.add.reduceat(weight.astype(np.int64), first)
        merged_weight = np.clip((sums + 2) // 4, 1, MAX_WEIGHT).astype(np.uint32)
    return Reduced(
        parents[first],
        merged_mask,
        parts["normal"].astype(np.uint16, copy=False),
        parts["colour"].astype(np.uint8, copy=False),
        merged_weight,
    )


def colour_codes(means: I64) -> U8:
    """(n, 4) u8 codes of (n, 4) means: linear 0...65535 for R, G, B, 0...255 for A."""
    codes = np.empty(means.shape, np.uint8)
    codes[:, :3] = CODE_OF_LINEAR[np.clip(means[:, :3], 0, 65_535)]
    codes[:, 3] = np.clip(means[:, 3], 0, 255)
    return codes


def finish_voxels(
    area: I64, area_vector: I64, colour_sum: I64, mask: U8, normal_bits: int
) -> tuple[U8, U16, U8, U32]:
    """Columns of level 0 from the voxelizer's sums.

    area        : (m,) int64, unit 2^-26 voxel faces
    area_vector : (m, 3) int64, any unit
    colour_sum  : (m, 4) int64, sums of area * linear u16 (R, G, B) and area * alpha; or (0, 4)
    mask        : (m,) u8
    returns: mask (0 becomes 63), normal (m, 2), colour (m, 4) or (0, 4), weight (m,) unit 2^-20
    """
    weight = np.clip((area + 32) >> 6, 1, MAX_WEIGHT).astype(np.uint32)
    means = rounded_mean(colour_sum, np.maximum(area[: len(colour_sum)], 1)[:, None])
    finished_mask = np.where(mask == 0, 63, mask).astype(np.uint8)
    return finished_mask, encode_normals(area_vector, normal_bits), colour_codes(means), weight
