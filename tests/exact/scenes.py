"""Triangles that are hard for a voxelizer: soups, scene-spanning ones, closed meshes.

Every array is int64 (n, 3, 3): triangle, vertex, (x, y, z), in units of 2^-snap_bits voxel.
Everything is seeded.
"""

from collections.abc import Callable
from math import gcd, sin
from random import Random

import numpy as np
from numpy.typing import NDArray

Vector = tuple[int, int, int]
Vertex = list[int]
Triangles = NDArray[np.int64]
Maker = Callable[[Random, int, int], list[Vertex]]  # (random, units per voxel, box edge in voxels)


def soup(kind: str, seed: int, count: int, snap_bits: int, low: Vector, edge: int) -> Triangles:
    """count triangles of one kind in and a little around the box low .. low + edge voxels."""
    random = Random(f"{kind} {seed}")
    unit = 1 << snap_bits
    made = [_axes_mixed(random, KINDS[kind](random, unit, edge)) for _ in range(count)]
    return np.array(made, np.int64).reshape(-1, 3, 3) + np.array(low, np.int64) * unit


def _axes_mixed(random: Random, triangle: list[Vertex]) -> list[Vertex]:
    order = random.sample(range(3), 3)
    return [[vertex[axis] for axis in order] for vertex in random.sample(triangle, 3)]


def _anywhere(random: Random, unit: int, edge: int) -> int:
    return random.randrange(-edge * unit // 4, edge * unit * 5 // 4 + 1)


def _near(random: Random, unit: int, edge: int, step: int) -> int:
    """A multiple of step, in the box or at most an eighth of its edge outside."""
    return random.randrange(-edge * unit // 8 // step, edge * unit * 9 // 8 // step + 1) * step


def _generic(random: Random, unit: int, edge: int) -> list[Vertex]:
    return [[_anywhere(random, unit, edge) for _ in range(3)] for _ in range(3)]


def _small(random: Random, unit: int, edge: int) -> list[Vertex]:
    centre = [random.randrange(edge * unit + 1) for _ in range(3)]
    return [[c + random.randint(-unit, unit) for c in centre] for _ in range(3)]


def _coplanar(random: Random, unit: int, edge: int) -> list[Vertex]:
    """In a plane between voxels (the box's own faces included) or through their centres."""
    plane = random.choice([0, edge * unit, random.randrange(edge) * unit])
    plane += random.choice([0, 0, unit // 2])
    return [[plane, _anywhere(random, unit, edge), _anywhere(random, unit, edge)] for _ in range(3)]


def _coplanar_lattice(random: Random, unit: int, edge: int) -> list[Vertex]:
    plane, step = _near(random, unit, edge, unit // 2), random.choice([unit, unit // 2])
    return [
        [plane, _near(random, unit, edge, step), _near(random, unit, edge, step)] for _ in range(3)
    ]


def _lattice(random: Random, unit: int, edge: int) -> list[Vertex]:
    return [[_near(random, unit, edge, unit) for _ in range(3)] for _ in range(3)]


def _small_lattice(random: Random, unit: int, edge: int) -> list[Vertex]:
    centre = [random.randrange(edge + 1) * unit for _ in range(3)]
    return [[c + random.randint(-2, 2) * unit // 2 for c in centre] for _ in range(3)]


def _half_lattice(random: Random, unit: int, edge: int) -> list[Vertex]:
    return [[_near(random, unit, edge, unit) + unit // 2 for _ in range(3)] for _ in range(3)]


def _edge_on_plane(random: Random, unit: int, edge: int) -> list[Vertex]:
    triangle = _generic(random, unit, edge)
    triangle[0][0] = triangle[1][0] = _near(random, unit, edge, unit)
    return triangle


def _edge_on_line(random: Random, unit: int, edge: int) -> list[Vertex]:
    """One edge along a lattice line or along a line through voxel centres."""
    triangle = _generic(random, unit, edge)
    for axis in (0, 1):
        triangle[0][axis] = triangle[1][axis] = _near(random, unit, edge, unit // 2)
    return triangle


def _edge_on_diagonal(random: Random, unit: int, edge: int) -> list[Vertex]:
    """One edge along the space diagonals of a row of voxels."""
    triangle = _generic(random, unit, edge)
    start = [random.randrange(edge + 1) * unit for _ in range(3)]
    length = random.randrange(1, edge * unit)
    direction = [random.choice([-1, 1]) for _ in range(3)]
    triangle[0] = start
    triangle[1] = [s + length * d for s, d in zip(start, direction, strict=True)]
    return triangle


def _needle(random: Random, unit: int, edge: int) -> list[Vertex]:
    """Length about L = edge * unit and height about 1 / L, so the aspect is about L^2."""
    while True:
        p, q = (random.randrange(edge * unit // 2, edge * unit) for _ in range(2))
        if gcd(p, q) == 1 and q > 1:
            break
    r = pow(p, -1, q)
    s = (p * r - 1) // q  # p r - q s = 1: twice the area of (0, 0), (p, q), (s, r)
    m, n = random.choice([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])
    start = [
        random.randrange(unit),
        random.randrange(unit),
        random.choice([0, random.randrange(unit)]),
    ]
    start[2] += edge * unit * (m + n < 0)
    flat = ((0, 0), (p, q), (s, r))
    return [[start[0] + x, start[1] + y, start[2] + m * x + n * y] for x, y in flat]


def _degenerate(random: Random, unit: int, edge: int) -> list[Vertex]:
    """A segment or a point: collinear or equal vertices, on the lattice, half-lattice or not."""
    step = random.choice([unit, unit // 2, 1])
    a, b = ([_near(random, unit, edge, step) for _ in range(3)] for _ in range(2))
    for axis in random.sample(range(3), random.choice([0, 0, 1, 2])):
        b[axis] = a[axis]
    shape = random.choice(["point", "two equal", "between", "beyond"])
    if shape == "point":
        return [a, list(a), list(a)]
    if shape == "two equal":
        return [a, b, list(a)]
    b = [s + 2 * ((t - s) // 2) for s, t in zip(a, b, strict=True)]
    middle = [(s + t) // 2 for s, t in zip(a, b, strict=True)]
    beyond = [2 * t - s for s, t in zip(a, b, strict=True)]
    return [a, b, middle if shape == "between" else beyond]


def _tiny(random: Random, unit: int, edge: int) -> list[Vertex]:
    """One or two snap units across, mostly around lattice points and voxel centres."""
    step = random.choice([unit, unit, unit // 2, 1])
    at = [random.randrange(edge * unit // step + 1) * step for _ in range(3)]
    return [[c + random.choice([-1, 0, 0, 1]) for c in at] for _ in range(3)]


def _tie_plane(random: Random, unit: int, edge: int) -> list[Vertex]:
    """In x + y + z = c, x + y - z = c, or x - y = c, where c is a multiple of half a voxel."""
    signs = random.choice([(1, 1), (1, -1), (-1, 0)])
    step = random.choice([1, 1, unit])
    centre = [random.randrange(edge) * unit for _ in range(3)]
    c = random.choice([0, 0, unit // 2]) + centre[0] + signs[0] * centre[1] + signs[1] * centre[2]
    triangle = []
    for _ in range(3):
        y, z = (_near(random, unit, edge, step) for _ in range(2))
        triangle.append([c - signs[0] * y - signs[1] * z, y, z])
    return triangle


def _touching(random: Random, unit: int, edge: int) -> list[Vertex]:
    """A corner, an edge or all of it in a face of the box, the rest of it on either side."""
    triangle, face = _generic(random, unit, edge), random.choice([0, edge * unit])
    side = random.choice([-1, 1])
    depths = [0, *(random.choice([0, 1, random.randrange(edge * unit)]) for _ in range(2))]
    for vertex, depth in zip(triangle, depths, strict=True):
        vertex[0] = face + side * depth
    return triangle


KINDS: dict[str, Maker] = {
    "generic": _generic,
    "small": _small,
    "coplanar": _coplanar,
    "coplanar lattice": _coplanar_lattice,
    "lattice": _lattice,
    "small lattice": _small_lattice,
    "half-lattice": _half_lattice,
    "edge on a plane": _edge_on_plane,
    "edge on a line": _edge_on_line,
    "edge on a diagonal": _edge_on_diagonal,
    "needle": _needle,
    "degenerate": _degenerate,
    "tiny": _tiny,
    "tie plane": _tie_plane,
    "touching": _touching,
}


def _spanning(random: Random, size: int, unit: int, kind: str) -> list[Vertex]:
    if kind == "generic":
        return [[random.randrange(size) for _ in range(3)] for _ in range(3)]
    if kind == "lattice":
        return [[random.randrange(size // unit + 1) * unit for _ in range(3)] for _ in range(3)]
    if kind == "corner to corner":
        return [[random.choice([0, size]) for _ in range(3)] for _ in range(3)]
    if kind == "near-parallel":  # a slope of a few snap units over the whole scene
        plane = random.randrange(size // unit - 1) * unit
        near = [[plane + random.randint(-3, 3)] for _ in range(3)]
        return [x + [random.randrange(size) for _ in range(2)] for x in near]
    if kind == "slope 5e-7":  # passes a plane between voxels, or through their centres, inside
        plane = random.randrange(2, 2 * (size // unit) - 2) * unit // 2
        rise = size // 4_000_000
        low = [plane - rise, random.randrange(size // 4), random.randrange(size)]
        high = [plane + rise, size - random.randrange(size // 4), random.randrange(size)]
        return [low, high, [plane, random.randrange(size), random.randrange(size)]]
    if kind == "sliver":
        a, b = ([random.randrange(size) for _ in range(3)] for _ in range(2))
        middle = [(s + t) // 2 + random.randint(-1, 1) for s, t in zip(a, b, strict=True)]
        return [a, b, middle]
    return _tie_plane(random, unit, size // unit)


SPANNING = (
    "generic", "lattice", "corner to corner", "near-parallel", "slope 5e-7", "sliver", "tie plane",
)  # fmt: skip


def spanning(kind: str, seed: int, count: int, resolution: int, snap_bits: int) -> Triangles:
    """count triangles as large as a grid of resolution^3 voxels."""
    random = Random(f"{kind} {seed} {resolution}")
    unit = 1 << snap_bits
    made = [
        _axes_mixed(random, _spanning(random, resolution * unit, unit, kind)) for _ in range(count)
    ]
    return np.array(made, np.int64)


def places_on(triangle: NDArray[np.int64], random: Random, snap_bits: int) -> list[Vector]:
    """Voxels that the triangle passes: inside, along each edge, and at a corner."""
    spots = []
    for weights in ((3, 4, 5), (1, 0, 3), (5, 2, 0), (0, 7, 2), (1, 0, 0)):
        shares = [w * random.randint(1, 1000) for w in weights]
        total = sum(shares)
        x, y, z = (
            sum(s * int(c) for s, c in zip(shares, triangle[:, axis], strict=True)) // total
            for axis in range(3)
        )
        spots.append((x >> snap_bits, y >> snap_bits, z >> snap_bits))
    return spots


def places_at_wraps(
    triangle: NDArray[np.int64], random: Random, snap_bits: int, count: int
) -> list[Vector]:
    """Voxels on a triangle where a product n_c * index leaves int64, n the integer normal.

    The index counts from the lowest voxel of the triangle. Signed overflow is undefined in compiled
    code, so a sum that is right modulo 2^64 may still compare wrongly here, and only here.
    """
    corners = [[int(c) for c in vertex] for vertex in triangle]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    u, v = (bx - ax, by - ay, bz - az), (cx - ax, cy - ay, cz - az)
    normal = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    places: list[Vector] = []
    for _ in range(20 * count):
        axis, share = random.randrange(3), random.random()
        a, b, c = random.sample(corners, 3)
        across = [p + round(share * (q - p)) for p, q in zip(b, c, strict=True)]
        low = min(corner[axis] for corner in corners) >> snap_bits
        wraps = abs(normal[axis]) * max(
            abs(x - (low << snap_bits)) for x in (a[axis], across[axis])
        )
        if not wraps >> (63 + snap_bits) or a[axis] == across[axis]:
            continue
        odd = 2 * random.randrange((wraps >> (64 + snap_bits)) + 1) + 1
        at = (low << snap_bits) + ((odd << (63 + snap_bits)) // abs(normal[axis]))
        share = (at - a[axis]) / (across[axis] - a[axis])
        if 0 <= share <= 1:
            x, y, z = (p + round(share * (q - p)) for p, q in zip(a, across, strict=True))
            places.append((x >> snap_bits, y >> snap_bits, z >> snap_bits))
    return places[:count]


def octahedron(centre: Vector, radius: int) -> Triangles:
    """|x| + |y| + |z| = radius around centre, outward, snap units."""
    faces = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            for sz in (-1, 1):
                face = [[sx * radius, 0, 0], [0, sy * radius, 0], [0, 0, sz * radius]]
                faces.append(face if sx * sy * sz > 0 else face[::-1])
    return np.array(faces, np.int64) + np.array(centre, np.int64)


def box(low: Vector, high: Vector) -> Triangles:
    """The twelve outward triangles of an axis-aligned box, snap units."""
    return hull_of_cube([[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])


def turned_box(centre: Vector, reach: int, height: int) -> Triangles:
    """A box turned 45 degrees about z: the square |x| + |y| <= reach, |z| <= height, snap units."""
    corners = []
    for i in range(8):
        x, y = ((-reach, 0), (0, -reach), (0, reach), (reach, 0))[i & 3]
        corners.append([centre[0] + x, centre[1] + y, centre[2] + (height if i & 4 else -height)])
    return hull_of_cube(corners)


def hull_of_cube(corners: list[Vertex]) -> Triangles:
    """Triangles of a hexahedron; bits 0, 1, 2 of a corner's number say high x, high y, high z."""
    quads = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
    triangles = [[a, b, c] for a, b, c, d in quads] + [[a, c, d] for a, b, c, d in quads]
    return np.array([[corners[i] for i in face] for face in triangles], np.int64)


def tetrahedron(random: Random, size: int, step: int) -> Triangles:
    """Four outward triangles on multiples of step within 0 .. size snap units; never flat."""
    while True:
        corners = np.array(
            [[random.randrange(size // step + 1) * step for _ in range(3)] for _ in range(4)]
        )
        a, b, c, d = ([int(x) for x in corner] for corner in corners)
        u, v, w = ([q - p for p, q in zip(a, other, strict=True)] for other in (b, c, d))
        volume = (
            u[0] * (v[1] * w[2] - v[2] * w[1])
            - u[1] * (v[0] * w[2] - v[2] * w[0])
            + u[2] * (v[0] * w[1] - v[1] * w[0])
        )
        if volume:
            order = (0, 1, 2, 3) if volume > 0 else (0, 2, 1, 3)
            p, q, r, s = (corners[i] for i in order)
            return np.array([[p, r, q], [p, q, s], [q, r, s], [r, p, s]], np.int64)


def subdivided(triangles: Triangles, times: int) -> Triangles:
    """Each triangle as 4^times, by edge midpoints; coordinates must be multiples of 2^times."""
    for _ in range(times):
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        if np.any((a + b) & 1) or np.any((b + c) & 1) or np.any((c + a) & 1):
            raise ValueError("a midpoint is not representable")
        ab, bc, ca = (a + b) // 2, (b + c) // 2, (c + a) // 2
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
    return triangles


def split(triangles: Triangles, random: Random) -> Triangles:
    """Each triangle as three around a lattice point of its plane one step from an edge.

    The edge's own part is a needle of the height of one step. The edges must have a common divisor
    of at least 3.
    """
    parts = []
    for triangle in np.roll(triangles, random.randrange(3), axis=1).tolist():
        a, b, c = triangle
        u, v = ([q - p for p, q in zip(a, end, strict=True)] for end in (b, c))
        steps = gcd(*u, *v)
        along = random.randrange(1, steps - 1)
        p = [s + (along * i + j) // steps for s, i, j in zip(a, u, v, strict=True)]
        parts += [[a, b, p], [b, c, p], [c, a, p]]
    return np.array(parts, np.int64)


def sphere(steps: int, radius: float, centre: Vector, snap: int, wobble: float = 0.0) -> Triangles:
    """A closed bumpy sphere of 8 steps^2 triangles, its vertices on multiples of snap snap units.

    Each vertex is a pure function of its place on the octahedron, so the mesh is closed to the bit;
    triangles that the snapping flattens are kept.
    """

    def vertex(p: Vertex) -> Vertex:
        x, y, z = (c / sum(c * c for c in p) ** 0.5 for c in p)
        scale = radius * (1 + wobble * sin(5 * x + 1) * sin(7 * y) * sin(6 * z + 2)) / snap
        return [o + snap * round(scale * c) for o, c in zip(centre, (x, y, z), strict=True)]

    made = []
    for face in octahedron((0, 0, 0), 1).tolist():
        a, b, c = face
        for i in range(steps):
            for j in range(steps - i):
                for up in (True, False):
                    if not up and i + j >= steps - 1:
                        continue
                    places = ((i, j), (i + 1, j), (i, j + 1))
                    if not up:
                        places = ((i + 1, j), (i + 1, j + 1), (i, j + 1))
                    made.append([
                        vertex([(steps - s - t) * p + s * q + t * r
                                for p, q, r in zip(a, b, c, strict=True)])
                        for s, t in places
                    ])  # fmt: skip
    return np.array(made, np.int64)
