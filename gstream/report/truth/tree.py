"""Exact distances from a mesh: a tree of boxes over its triangles in Morton order."""

import numpy as np

from gstream.formats.morton import encode_morton
from gstream.report.truth.scene import Floats, Ints

POINTS = 1 << 12  # asked at once: some hundred boxes and triangles to each
FAN = 4  # boxes in a box; 8 took half as long again


class Tree:
    """Boxes about four boxes each, from the triangles' own up to one about all."""

    def __init__(self, held: Floats) -> None:
        """held : (m, 3, 3) corners of triangles with an area, m > 0"""
        middles = held.mean(axis=1)
        self._low = middles.min(axis=0)
        self._scale = 65_535 / max(float(np.ptp(middles, axis=0).max()), 1e-300)
        codes = self._codes(middles)
        order = np.argsort(codes)
        self._held, self._sorted = held[order], codes[order]
        a, b, c = self._held.transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        low, high = self._held.min(axis=1), self._held.max(axis=1)
        self._boxes = [(low, high)]
        while len(low) > 1:
            starts = np.arange(0, len(low), FAN)
            low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
            self._boxes.append((low, high))

    def nearest(self, at: Floats) -> tuple[Floats, Floats]:
        """Distance from the surface, and the nearest triangle's normal.

        at : (k, 3); returns : (k,), (k, 3) unit vectors, of any one triangle where several are
        nearest
        """
        square, owner = np.empty(len(at)), np.empty(len(at), np.int64)
        for begin in range(0, len(at), POINTS):
            part = slice(begin, begin + POINTS)
            square[part], owner[part] = self._nearest(at[part])
        return np.sqrt(square), self._normals[owner]

    def _nearest(self, at: Floats) -> tuple[Floats, Ints]:
        """(k,) least squared distance, and the triangle it is to."""
        guess = np.minimum(np.searchsorted(self._sorted, self._codes(at)), len(self._sorted) - 1)
        bound = _square(at, self._held[guess])
        slack = 1e-12 * max(np.abs(at).max(), np.abs(self._boxes[-1]).max())  # above all rounding
        point = np.arange(len(at))
        box = np.zeros(len(at), np.int64)
        for low, high in self._boxes[-2::-1]:
            point, box = np.repeat(point, FAN), (FAN * box[:, None] + np.arange(FAN)).ravel()
            there = box < len(low)
            point, box = point[there], box[there]
            below, above = low[box] - at[point], at[point] - high[box]
            outside = np.maximum(np.maximum(below, above), 0)
            gap = _dot(outside, outside)
            # no triangle in the box is farther than the box's farthest corner
            across = np.minimum(below, above)
            starts = np.searchsorted(point, np.arange(len(at)))
            bound = np.minimum(bound, np.minimum.reduceat(_dot(across, across), starts))
            reach = (np.sqrt(bound) + slack) ** 2
            near = gap <= reach[point]
            point, box = point[near], box[near]
        square = _square(at[point], self._held[box])
        starts = np.searchsorted(point, np.arange(len(at)))
        least = np.minimum.reduceat(square, starts)
        owner = np.empty(len(at), np.int64)
        owner[point[square == least[point]]] = box[square == least[point]]
        return least, owner

    def _codes(self, at: Floats) -> Ints:
        """Morton codes of (n, 3) points, in 2^16 steps along the longest side."""
        steps = np.clip((at - self._low) * self._scale, 0, 65_535)
        return encode_morton(steps).astype(np.int64)


def _square(at: Floats, held: Floats) -> Floats:
    """(n,) squared distance of (n, 3) points from (n, 3, 3) triangles, one each."""
    a = held[:, 0]
    e, f = held[:, 1] - a, held[:, 2] - a
    normal = np.cross(e, f)
    size = _dot(normal, normal)
    from_a = at - a
    v = _dot(np.cross(from_a, f), normal)
    w = _dot(np.cross(e, from_a), normal)
    over = (v >= 0) & (w >= 0) & (v + w <= size)
    plane = _dot(from_a, normal) ** 2 / size
    sides = [_square_from_line(at, held[:, i], held[:, (i + 1) % 3]) for i in range(3)]
    return np.where(over, plane, np.minimum(np.minimum(*sides[:2]), sides[2]))


def _square_from_line(at: Floats, begin: Floats, end: Floats) -> Floats:
    """(n,) squared distance of (n, 3) points from segments with a length, one each."""
    way = end - begin
    part = _dot(at - begin, way) / _dot(way, way)
    foot = begin + np.clip(part, 0, 1)[:, None] * way
    return _dot(at - foot, at - foot)


def _dot(a: Floats, b: Floats) -> Floats:
    """(n,) products of (n, 3) vectors; half the time of a sum over the last axis."""
    products: Floats = np.einsum("ij,ij->i", a, b)
    return products
