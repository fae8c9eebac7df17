"""OBJ, spilled: vertices as f8, polygons as fans, vertex colours, normals, and Kd of materials."""

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gstream.errors import InputError
from gstream.kernels import wavefront as kernel
from gstream.readers import mtl
from gstream.readers.mesh import DiskArray, Mesh
from gstream.readers.scratch import Column, LateColumn, Spill
from gstream.readers.text_blocks import TextBlocks

ROWS = 1 << 16  # vertices, normals and triangles per batch
SLOW = 1 << 15
MAX_LIBRARIES = 1 << 12  # whose names are kept, 4 KB each at most
WHITE = (255, 255, 255, 255)
NAN = float("nan")
REMEDY = "correct the line, or export the OBJ file again"


def open_obj(path: Path, name: str, folder: Path, spill: Spill) -> Mesh:
    """Read an OBJ through once; mtllib files are looked for inside `folder` only.

    A vertex that faces use with several normals keeps the last one in the file's order.
    """
    with open(path, "rb") as file:
        if file.read(3) != b"\xef\xbb\xbf":  # UTF-8's byte order mark
            file.seek(0)
        reading = _Reading(TextBlocks(file, name), path.stat().st_size, folder, spill)
        reading.read()
    return reading.mesh(name)


@dataclass(slots=True)
class _Materials:
    """Names to numbers from 1 on, and the colours known so far."""

    folder: Path
    numbers: dict[bytes, int] = field(default_factory=dict)
    known: dict[bytes, mtl.Colour] = field(default_factory=dict)
    missing: int = 0
    outside: int = 0
    named: set[str] = field(default_factory=set)  # paths of libraries, be they there or not

    def use(self, name: bytes) -> int:
        if name not in self.numbers and len(self.numbers) < mtl.MAX_MATERIALS:
            self.numbers[name] = len(self.numbers) + 1
        return self.numbers.get(name, 0)

    def load(self, names: bytes) -> None:
        """Read the libraries of a mtllib line: one name with spaces, or several names."""
        whole = mtl.inside(self.folder, names)
        self._note(whole)
        several = [part.replace(b"\\ ", b" ") for part in re.split(rb"(?<!\\)\s+", names)]
        for name in [names] if whole is not None and whole.is_file() else several:
            path = mtl.inside(self.folder, name)
            self._note(path)
            if path is None:
                self.outside += 1
            elif not path.is_file():
                self.missing += 1
            else:
                try:
                    self.known.update(mtl.read_colours(path))
                except OSError:
                    self.missing += 1

    def _note(self, path: Path | None) -> None:
        if path is not None and len(self.named) < MAX_LIBRARIES:
            self.named.add(str(path))

    def palette(self) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.bool_]]:
        """Colours (m + 1, 4) by number, and which of them are known."""
        codes = np.full((len(self.numbers) + 1, 4), 255, np.uint8)
        known = np.zeros(len(codes), np.bool_)
        for name, number in self.numbers.items():
            if name in self.known:
                codes[number], known[number] = self.known[name], True
        return codes, known

    def unknown(self) -> int:
        return sum(name not in self.known for name in self.numbers)


class _Reading:
    """One pass over the lines, and the columns it fills."""

    def __init__(self, blocks: TextBlocks, size: int, folder: Path, spill: Spill) -> None:
        self.blocks, self.spill = blocks, spill
        self.state = kernel.new_state()
        self.materials = _Materials(folder)
        ids = np.empty((ROWS, 3), np.int64)
        floats = [np.empty((ROWS, 3)) for _ in range(3)]
        self.out = (*floats, np.empty((SLOW, 5), np.int64), ids, ids.copy(), ids[:, 0].copy())
        wide = size >= 1 << 34  # a vertex takes 6 bytes of text or more
        self.positions = Column(spill("positions"), "<f8", 3)
        self.directions = Column(spill("directions"), "<f4", 3)
        self.triangles = Column(spill("triangles"), "<u8" if wide else "<u4", 3)
        self.corners = LateColumn(spill("corner_normals"), "<i8" if wide else "<i4", (-1, -1, -1))
        self.colours = LateColumn(spill("colour_values"), "<f4", (NAN, NAN, NAN))
        self.painted = LateColumn(spill("triangle_colours"), "|u1", WHITE)
        self.brightest = 0.0

    def read(self) -> None:
        blocks, at, more = self.blocks, 0, True
        self._check_text()
        while more:
            parsed = kernel.parse_lines(blocks.text, at, blocks.stop, self.state, self.out)
            at, code, where = (int(v) for v in parsed)
            self._round_slow()
            if code == kernel.MATERIAL_LINE:
                self._material(blocks.text[at:where].tobytes())
                at = where
            elif code == kernel.FULL:
                self._flush()
            elif code == kernel.MORE_TEXT:
                more = blocks.use(at)
                at = 0
                self._check_text()
            else:
                raise self._wrong(code, where)
        self._flush()

    def _check_text(self) -> None:
        zeros = np.flatnonzero(self.blocks.text[: self.blocks.stop] == 0)
        if len(zeros):
            raise self.blocks.error(int(zeros[0]), "holds a zero byte, so it is no text", REMEDY)

    def _wrong(self, code: int, at: int) -> InputError:
        token = self.blocks.token(at)
        face, vertices = self.state[kernel.FACES], self.state[kernel.ALL_VERTICES]
        said = {
            kernel.BAD_NUMBER: f"{token} is not a number",
            kernel.BAD_VERTEX: "a vertex or normal has fewer than three coordinates",
            kernel.BAD_INDEX: f"face {face} has the vertex {token}, {vertices} stand before it",
        }[code]
        return self.blocks.error(at, said, REMEDY)

    def _round_slow(self) -> None:
        for kind, row, column, start, end in self.out[3][: self.state[kernel.WAITING]]:
            value = float(self.blocks.text[start:end].tobytes())
            if column < 3:
                self.out[kind][row, column] = value
            elif column < 6 and not np.isnan(self.out[1][row, column - 3]):
                self.out[1][row, column - 3] = value
        self.state[kernel.WAITING] = 0

    def _material(self, line: bytes) -> None:
        words = line.split(None, 1)
        rest = words[1].strip() if len(words) > 1 else b""
        if words[0] == b"usemtl":
            self.state[kernel.MATERIAL] = self.materials.use(rest[: mtl.MAX_LINE])
        elif rest:
            self.materials.load(rest[: 4 * mtl.MAX_LINE])

    def _flush(self) -> None:
        positions, colours, directions, _, triangles, corners, materials = self.out
        vertices, made, normals = (int(n) for n in self.state[:3])
        self.positions.append(positions[:vertices])
        self.directions.append(directions[:normals])
        self.triangles.append(triangles[:made])
        given = colours[:vertices]
        if np.isfinite(given).any():
            self.brightest = max(self.brightest, float(given[np.isfinite(given)].max()))
            self.colours.started().append(given)
        else:
            self.colours.pass_over(vertices)
        if (corners[:made] != kernel.NO_NORMAL).any():
            self.corners.started().append(corners[:made])
        else:
            self.corners.pass_over(made)
        codes, known = self.materials.palette()
        if made and known[materials[:made]].any():
            self.painted.started().append(codes[materials[:made]])
        else:
            self.painted.pass_over(made)
        self.state[:3] = 0

    def mesh(self, name: str) -> Mesh:
        state = self.state
        if state[kernel.LAST_VERTEX] >= state[kernel.ALL_VERTICES]:
            face, vertex = state[kernel.LAST_FACE], state[kernel.LAST_VERTEX] + 1
            said = f"has the vertex {vertex}, the file has {state[kernel.ALL_VERTICES]}"
            raise InputError(name, f"face {face}", said, "export the OBJ file again")
        triangles, positions = self.triangles.close(), self.positions.close()
        normals, lost = self._normals(triangles, positions.shape[0])
        colours = self._colours()
        painted = self.painted.close()
        notes = {
            "lines_not_read": int(state[kernel.UNREAD]),
            "material_files_missing": self.materials.missing,
            "material_files_outside": self.materials.outside,
            "materials_without_colour": self.materials.unknown(),
            "normals_out_of_range": lost,
        }
        return Mesh(
            name,
            positions,
            triangles,
            triangles.shape[0],
            normals=normals,
            colours=colours,
            triangle_colours=painted if colours is None else None,
            faces=int(state[kernel.FACES]),
            skipped_faces=int(state[kernel.SKIPPED]),
            notes={key: count for key, count in notes.items() if count},
            beside=tuple(sorted(self.materials.named)),
        )

    def _normals(self, triangles: DiskArray, vertices: int) -> tuple[DiskArray | None, int]:
        """Give each vertex the last normal that a face gives it; also the ids without a normal."""
        directions, corners = self.directions.close(), self.corners.close()
        if corners is None or not vertices:
            return None, 0
        path = self.spill("normals")
        with open(
            path, "wb"
        ) as file:  # a disk that is full tells it here: a map's writer is killed
            os.posix_fallocate(file.fileno(), 0, 12 * vertices)
        of_vertex = np.memmap(path, "<f4", "r+", shape=(vertices, 3))
        given, lost = directions.map(), 0
        for first in range(0, triangles.shape[0], ROWS):
            ids = corners.map()[first : first + ROWS].ravel()
            vertex = triangles.map()[first : first + ROWS].ravel()
            there = (ids >= 0) & (ids < len(given))
            lost += int(np.count_nonzero(~there & (ids != kernel.NO_NORMAL)))
            of_vertex[vertex[there]] = given[ids[there]]
        of_vertex.flush()
        return DiskArray(str(path), 0, "<f4", (vertices, 3), (12, 4)), lost

    def _colours(self) -> DiskArray | None:
        """Vertex colours as codes: values are 0..1, or 0..255 when the file has any above 1."""
        values = self.colours.close()
        if values is None:
            return None
        scale = 255.0 if self.brightest <= 1 else 1.0
        column = Column(self.spill("colours"), "|u1", 4)
        for first in range(0, values.shape[0], ROWS):
            block = values.map()[first : first + ROWS].astype(np.float64) * scale
            codes = np.full((len(block), 4), 255, np.uint8)
            codes[:, :3] = np.floor(np.clip(np.nan_to_num(block, nan=255.0), 0, 255) + 0.5)
            column.append(codes)
        return column.close()
