"""Voxels as PLY, binary and little-endian: centres as points, or cubes of six quads.

Source: Greg Turk, "The PLY Polygon File Format", 1994; the names of normals and colours are those
that MeshLab, CloudCompare, Blender and Open3D read.
"""

from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from gstream.formats.pieces import TRIANGLE, VERTEX
from gstream.selection import Piece, Progress, Selection

NAMES: Final = {"<f4": "float", "<f8": "double", "<u4": "uint", "|u1": "uchar"}
AXES: Final = ("x", "y", "z")
COLOURS: Final = ("red", "green", "blue", "alpha")
FIELDS: Final[dict[str, tuple[tuple[str, ...], str]]] = {  # column -> properties, dtype
    "normal": (("nx", "ny", "nz"), "<f4"),
    "colour": (COLOURS, "|u1"),
    "mask": (("mask",), "|u1"),
    "weight": (("weight",), "<u4"),
    "label": (("label",), "<u4"),
    "spread": (("spread",), "|u1"),
}
CORNERS: Final = np.indices((2, 2, 2)).reshape(3, 8).T[:, ::-1]  # bit 0 of the number is x
QUADS: Final = np.array(  # corners of each side, counter-clockwise from outside: -x +x -y +y -z +z
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]], np.int32
)
MAX_CUBES: Final = (1 << 31) // 8  # a corner's number is an int
FINE: Final = 64.0  # steps of a float within a voxel; fewer, and positions are doubles


def write_points(out: BinaryIO, selection: Selection, progress: Progress) -> tuple[str, ...]:
    """Write the centre of every voxel with all its columns; the columns' names."""
    names = tuple(name for name in FIELDS if name in selection.attributes)
    fields = [(axis, _position_type(selection)) for axis in AXES]
    fields += [(field, FIELDS[name][1]) for name in names for field in FIELDS[name][0]]
    out.write(_header(selection, ("vertex", selection.voxels, _properties(fields))))
    for piece in selection.pieces(names, progress):
        rows = np.empty(len(piece.positions), fields)
        _fill(rows, AXES, _in_world(piece.positions + 0.5, selection.matrix))
        for name in names:
            _fill(rows, FIELDS[name][0], piece.columns[name].reshape(len(rows), -1))
        out.write(rows.data)
    return names


def write_cubes(out: BinaryIO, selection: Selection, progress: Progress) -> tuple[str, ...]:
    """Write every voxel as eight corners of its colour and six quads; the columns' names."""
    names = tuple(name for name in ("colour",) if name in selection.attributes)
    fields = [(axis, _position_type(selection)) for axis in AXES]
    fields += [(field, "|u1") for field in (COLOURS if names else ())]
    corners = ("vertex", 8 * selection.voxels, _properties(fields))
    sides = ("face", 6 * selection.voxels, ["property list uchar int vertex_indices"])
    out.write(_header(selection, corners, sides))
    for piece in selection.pieces(names, progress):
        out.write(_corners(piece, selection.matrix, fields, names).data)
    mirrored = np.linalg.det(selection.matrix[:, :3]) < 0
    quads = QUADS[:, ::-1] if mirrored else QUADS
    step = 1 << 16
    for begin in range(0, selection.voxels, step):
        cubes = np.arange(begin, min(begin + step, selection.voxels), dtype=np.int32)
        rows = np.empty((len(cubes), 6), [("count", "u1"), ("corners", "<i4", 4)])
        rows["count"] = 4
        rows["corners"] = 8 * cubes[:, None, None] + quads
        out.write(rows.data)
    return names


def write_triangles(out: BinaryIO, selection: Selection, progress: Progress) -> tuple[str, ...]:
    """Write the source triangles of the blocks; the columns' names.

    What neighbouring blocks share stands in each of them, at the same place to the bit.
    """
    counts = np.array([view.piece_counts for view in selection.views(())]).reshape(-1, 2)
    vertices, triangles = counts.sum(axis=0).tolist()
    fields = [(axis, _position_type(selection)) for axis in AXES]
    faces = ("face", triangles, ["property list uchar int vertex_indices"])
    out.write(_header(selection, ("vertex", vertices, _properties(fields)), faces))
    unit, done = 2.0**-selection.file.header.snap_bits, 0
    for view in selection.views(()):
        corners = view.corner + view.pieces().vertices * unit
        rows = np.empty(len(corners), fields)
        _fill(rows, AXES, _in_world(corners, selection.matrix))
        out.write(rows.data)
        progress(done := done + 1, 2 * len(counts))
    mirrored = np.linalg.det(selection.matrix[:, :3]) < 0
    for view, first in zip(
        selection.views(()), np.cumsum(counts[:, 0]) - counts[:, 0], strict=True
    ):
        numbers = view.pieces().triangles.astype(np.int64) + first
        sides = np.empty(len(numbers), [("count", "u1"), ("corners", "<i4", 3)])
        sides["count"] = 3
        sides["corners"] = numbers[:, ::-1] if mirrored else numbers
        out.write(sides.data)
        progress(done := done + 1, 2 * len(counts))
    return (VERTEX, TRIANGLE)


def _corners(
    piece: Piece, matrix: NDArray[np.float64], fields: list[tuple[str, str]], names: tuple[str, ...]
) -> NDArray[Any]:
    rows = np.empty((len(piece.positions), 8), fields)
    places = (piece.positions[:, None, :] + CORNERS).reshape(-1, 3)
    _fill(rows, AXES, _in_world(places, matrix).reshape(-1, 8, 3))
    for name in names:
        _fill(rows, FIELDS[name][0], piece.columns[name][:, None, :])
    return rows


def _fill(rows: NDArray[Any], fields: tuple[str, ...], values: NDArray[Any]) -> None:
    for i, field in enumerate(fields):
        rows[field] = values[..., i]


def _in_world(places: NDArray[Any], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(places @ matrix[:, :3].T + matrix[:, 3], np.float64)


def _position_type(selection: Selection) -> str:
    """Float where it resolves a voxel well: far from the origin, as on a map, it does not."""
    matrix = selection.matrix
    ends = np.where(CORNERS, selection.last + 1, selection.first)
    largest = np.abs(_in_world(ends, matrix)).max()
    edge = np.linalg.norm(matrix[:, :3], axis=0).min()
    fits = largest < np.finfo("<f4").max and np.spacing(np.float32(largest)) * FINE <= edge
    return "<f4" if fits else "<f8"


def _properties(fields: list[tuple[str, str]]) -> list[str]:
    return [f"property {NAMES[kind]} {name}" for name, kind in fields]


def _header(selection: Selection, *elements: tuple[str, int, list[str]]) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0"]
    lines.append(f"comment gstream export, level {selection.level}")
    for name, count, properties in elements:
        lines += [f"element {name} {count}", *properties]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")
