"""OFF: Geomview's object files, text and binary, read through once.

source: Geomview manual, section "OFF Files"; binary files without colour counts, and in
little-endian order, are what some exporters write instead.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from gstream.errors import InputError
from gstream.kernels import records as kernel
from gstream.kernels.text import REAL_TOKEN
from gstream.readers.mesh import DiskArray, Mesh
from gstream.readers.number_source import BinaryNumbers, NumberSource, TextNumbers
from gstream.readers.ply_columns import Table
from gstream.readers.ply_header import Element, Property
from gstream.readers.record_walk import Batch, Plan, append_repeated, walk
from gstream.readers.scratch import Column, LateColumn, Spill
from gstream.readers.text_blocks import TextBlocks

HEAD = 4096  # bytes that the first word and comments before it may take
MAGIC = re.compile(
    rb"(?:\s|#[^\r\n]*[\r\n])*(?P<st>ST)?(?P<c>C)?(?P<n>N)?(?P<dimension>4?n?)OFF(?![0-9A-Za-z])"
    rb"(?P<binary>[ \t]+BINARY[ \t]*\r?\n)?"
)
REMEDY = "export the OFF file again"
EXTRA = kernel.CAPTURED + 2  # columns of a captured list: items, length, whether one was real
COLOUR_RECORD = Property("colour", "f4", "i4")
FACE_RECORD = Property("vertex ids", "i4", "i4")
WHITE = (255, 255, 255, 255)


@dataclass(frozen=True, slots=True)
class _Kind:
    """What the first word says that a vertex has beside its position."""

    normals: bool = False
    colours: bool = False
    textures: bool = False


def open_off(path: Path, name: str, spill: Spill) -> Mesh:
    """Spill an OFF file: positions of text as f8, of binary mapped as f4; polygons are fans."""
    with open(path, "rb") as file:
        head = file.read(HEAD)
        magic = MAGIC.match(head)
        if magic is None:  # Geomview allows a file to start with its counts
            file.seek(0)
            return _text(file, _Kind(), name, 1, path.stat().st_size, spill)
        if magic["dimension"]:
            raise InputError(name, "line 1", "has vertices in more than 3 dimensions", REMEDY)
        kind = _Kind(bool(magic["n"]), bool(magic["c"]), bool(magic["st"]))
        file.seek(magic.end())
        if magic["binary"]:
            return _binary(path, file, kind, name, spill)
        passed = magic[0]
        line = 1 + passed.count(b"\n") + passed.count(b"\r") - passed.count(b"\r\n")
        return _text(file, kind, name, line, path.stat().st_size, spill)


def _text(file: BinaryIO, kind: _Kind, name: str, line: int, size: int, spill: Spill) -> Mesh:
    source = TextNumbers(TextBlocks(file, name, line), hashes=True)
    vertices, faces, place = _counts(source, name)
    if 6 * vertices + 4 * faces > size:
        said = (
            f"the header promises {vertices} vertices and {faces} faces, too many for {size} bytes"
        )
        raise InputError(name, place, said, "copy the file again")
    positions = Column(spill("positions"), "<f8", 3)
    normals = Column(spill("normals"), "<f4", 3) if kind.normals else None
    colours = Column(spill("colours"), "|u1", 4) if kind.colours else None
    scalars = 6 if kind.normals else 3
    roles = (kernel.SCALAR,) * scalars + (kernel.REST_OF_LINE,)
    plan = Plan("vertex", vertices, roles, tuple(range(scalars + 1)), scalars + EXTRA, vertices)
    extra = 0
    for batch in walk(source, plan, name):
        positions.append(batch.captured[:, :3])
        rest = batch.captured[:, scalars:].copy()
        rest[:, kernel.CAPTURED] -= 2 * kind.textures
        if normals is not None:
            normals.append(batch.captured[:, 3:6])
        if colours is not None:
            colours.append(_codes(rest)[0])
        else:
            extra += int(np.count_nonzero(rest[:, kernel.CAPTURED] > 0))
    plan = Plan("face", faces, (kernel.FAN, kernel.REST_OF_LINE), (-1, 0), EXTRA, vertices)
    found = (
        positions.close(),
        normals.close() if normals is not None else None,
        colours.close() if colours is not None else None,
    )
    notes = {"vertices_with_values_beyond_the_header": extra} if extra else {}
    return _faces(source, plan, name, found, spill, notes)


def _counts(source: TextNumbers, name: str) -> tuple[int, int, str]:
    """Vertices, faces, and where they stand; the edges after them are not needed."""
    roles = (kernel.SCALAR, kernel.SCALAR, kernel.REST_OF_LINE)
    for batch in walk(source, Plan("header", 1, roles, (0, 1, 2), 2 + EXTRA, 0), name):
        if len(batch.captured):
            counts = batch.captured[0, :2]
            place = source.place(source.at - 1)
            if not all(0 <= c < 2**63 and c == int(c) for c in counts):
                said = f"{counts[0]:g} vertices and {counts[1]:g} faces are no counts"
                raise InputError(name, place, said, REMEDY)
            return int(counts[0]), int(counts[1]), place
    raise InputError(name, "", "has no counts of vertices and faces", REMEDY)


def _codes(rest: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.bool_]]:
    """sRGB codes (n, 4) of captured lists, and which of them are colours.

    Three or four integers are 0..255, reals 0..1; one integer is an index into a colour map that
    the file does not carry, so it is no colour.
    """
    count = rest[:, kernel.CAPTURED]
    coloured = (count == 3) | (count == 4)
    items = np.nan_to_num(rest[:, : kernel.CAPTURED])
    unit = (rest[:, kernel.CAPTURED + 1] > 0) & (items[:, :3] <= 1).all(1)
    codes = np.clip(items * np.where(unit, 255.0, 1.0)[:, None], 0, 255)
    codes[count == 3, 3] = 255
    codes[~coloured] = 255
    return np.floor(codes + 0.5).astype(np.uint8), coloured


def _faces(
    source: NumberSource,
    plan: Plan,
    name: str,
    vertices: tuple[DiskArray, DiskArray | None, DiskArray | None],
    spill: Spill,
    notes: dict[str, int],
) -> Mesh:
    triangles = Column(spill("triangles"), "<u4" if plan.vertices < 1 << 32 else "<u8", 3)
    colours = LateColumn(spill("triangle_colours"), "|u1", WHITE)
    skipped = 0
    for batch in walk(source, plan, name):
        triangles.append(batch.triangles)
        skipped = batch.skipped
        _paint(colours, batch)
    made = triangles.close()
    return Mesh(
        name,
        vertices[0],
        made,
        made.shape[0],
        normals=vertices[1],
        colours=vertices[2],
        triangle_colours=colours.close(),
        faces=plan.rows,
        skipped_faces=skipped,
        notes=notes,
    )


def _paint(colours: LateColumn, batch: Batch) -> None:
    rest: npt.NDArray[Any] = batch.captured
    codes, coloured = _codes(rest) if rest.shape[1] else (rest, np.zeros(0, np.bool_))
    if coloured.any():
        append_repeated(colours.started(), codes, batch.made)
    else:
        colours.pass_over(int(batch.made.sum()))


def _binary(path: Path, file: BinaryIO, kind: _Kind, name: str, spill: Spill) -> Mesh:
    size, at = path.stat().st_size, file.tell()
    labels = ["x", "y", "z", *(["nx", "ny", "nz"] * kind.normals)]
    labels += ["red", "green", "blue", "alpha"] * kind.colours + ["s", "t"] * kind.textures
    order, vertices, faces = _binary_counts(file, 4 * len(labels), size, name)
    element = Element("vertex", vertices, tuple(Property(label, "f4") for label in labels))
    table = Table(element, str(path.absolute()), at + 12, order)
    positions = table.column((0, 1, 2))
    normals = table.column((3, 4, 5)) if kind.normals else None
    if positions is None:
        raise TypeError("three coordinates of one type have one gap")
    colours = None
    if kind.colours:
        first = labels.index("red")
        column = Column(spill("colours"), "|u1", 4)
        colours = table.converted(tuple(range(first, first + 4)), column)
    start = at + 12 + vertices * element.smallest
    file.seek(start)
    source = BinaryNumbers(file, name, order)
    source.flags[:] = REAL_TOKEN  # colours are floats
    plain = size - start == 16 * faces
    record = (FACE_RECORD,) if plain else (FACE_RECORD, COLOUR_RECORD)
    source.begin(Element("face", faces, record))
    roles, columns = (kernel.FAN, kernel.CAPTURED_LIST)[: len(record)], 0 if plain else EXTRA
    plan = Plan("face", faces, roles, (-1, 0)[: len(record)], columns, vertices)
    return _faces(source, plan, name, (positions, normals, colours), spill, {})


def _binary_counts(file: BinaryIO, vertex_bytes: int, size: int, name: str) -> tuple[str, int, int]:
    """Byte order, vertices and faces: Geomview's big-endian, unless only the other order fits."""
    at = file.tell()
    head = file.read(12)
    for order in (">", "<"):
        counts = [int(c) for c in np.frombuffer(head, order + "i4", len(head) // 4)]
        if len(counts) == 3 and min(counts) >= 0:
            vertices, faces, _ = counts
            if at + 12 + vertices * vertex_bytes + 4 * faces <= size:
                return order, vertices, faces
    said = "the counts of vertices and faces promise more than the file holds"
    raise InputError(name, f"byte {at}", said, "copy the file again")
