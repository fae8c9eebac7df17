"""Attributes of fixed-size PLY elements as columns: which properties, mapped or converted."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from gstream.readers.mesh import DiskArray
from gstream.readers.ply_header import Element
from gstream.readers.scratch import Column, Spill

COORDINATES = (("x", "y", "z"),)
NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
COLOURS = (
    ("red", "green", "blue", "alpha"),
    ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"),
    ("r", "g", "b", "a"),
)
BLOCK_ROWS = 1 << 17


def find(element: Element, spellings: tuple[tuple[str, ...], ...]) -> tuple[int, ...]:
    """Numbers of the scalar properties of the first spelling that is there whole; () when none."""
    scalars = {p.name: i for i, p in enumerate(element.properties) if not p.count}
    for spelling in spellings:
        if all(label in scalars for label in spelling[:3]):
            return tuple(scalars[label] for label in spelling if label in scalars)
    return ()


@dataclass(frozen=True, slots=True)
class Table:
    """A fixed element's records in a binary file."""

    element: Element
    path: str
    at: int  # byte of the first record
    order: str  # "<" or ">"

    def scalar(self, number: int) -> DiskArray:
        """Property `number` as an array (rows,)."""
        record = self.element.record(self.order)
        assert record.fields is not None
        kind, place = record.fields[str(number)][:2]
        return DiskArray(
            self.path, self.at + place, kind.str, (self.element.rows,), (record.itemsize,)
        )

    def column(self, numbers: tuple[int, ...]) -> DiskArray | None:
        """Properties `numbers` as a strided (rows, n); None when types or gaps differ."""
        parts = [self.scalar(i) for i in numbers]
        gaps = {b.offset - a.offset for a, b in pairwise(parts)}
        if len({p.dtype for p in parts}) > 1 or len(gaps) != 1 or min(gaps) < 0:
            return None
        shape, strides = (self.element.rows, len(parts)), (parts[0].strides[0], gaps.pop())
        return DiskArray(self.path, parts[0].offset, parts[0].dtype, shape, strides)

    def converted(self, numbers: tuple[int, ...], column: Column) -> DiskArray:
        """The same properties written to scratch, colours (u1 columns) scaled to sRGB codes."""
        parts = [self.scalar(i).map() for i in numbers]
        for first in range(0, self.element.rows, BLOCK_ROWS):
            blocks = [part[first : first + BLOCK_ROWS] for part in parts]
            kinds = [self.element.properties[i].kind for i in numbers]
            codes = column.dtype == "u1"
            column.append(as_codes(blocks, kinds) if codes else np.stack(blocks, 1))
        return column.close()


def as_codes(channels: list[npt.NDArray[Any]], kinds: list[str]) -> npt.NDArray[np.uint8]:
    """sRGB codes (n, 4) of 3 or 4 channels: floats are 0..1, u2 is 0..65535, the rest 0..255."""
    codes = np.full((len(channels[0]), 4), 255, np.uint8)
    for i, (channel, kind) in enumerate(zip(channels, kinds, strict=True)):
        top = 1 if kind[0] == "f" else 65535 if kind == "u2" else 255
        scaled = np.nan_to_num(channel.astype(np.float64), nan=0.0) * (255 / top)
        codes[:, i] = np.floor(np.clip(scaled, 0, 255) + 0.5)
    return codes


def attributes_of(
    table: Table, spill: Spill
) -> tuple[DiskArray, DiskArray | None, DiskArray | None]:
    """Positions, normals and colours of a vertex table, mapped where the layout allows."""
    return positions_of(table, spill), normals_of(table, spill), colours_of(table, spill, "colours")


def positions_of(table: Table, spill: Spill) -> DiskArray:
    """x, y, z: mapped when they are floats of one type, else f8 in scratch."""
    numbers = find(table.element, COORDINATES)
    mapped = table.column(numbers)
    if mapped is not None and mapped.dtype[1:] in ("f4", "f8"):
        return mapped
    return table.converted(numbers, Column(spill("positions"), "<f8", 3))


def normals_of(table: Table, spill: Spill) -> DiskArray | None:
    numbers = find(table.element, NORMALS)
    if not numbers:
        return None
    mapped = table.column(numbers)
    if mapped is not None and mapped.dtype[1:] == "f4":
        return mapped
    return table.converted(numbers, Column(spill("normals"), "<f4", 3))


def colours_of(table: Table, spill: Spill, name: str, width: int = 3) -> DiskArray | None:
    """sRGB codes: mapped when u1 with at least `width` channels, else (rows, 4) in scratch."""
    numbers = find(table.element, COLOURS)
    if not numbers:
        return None
    mapped = table.column(numbers)
    if mapped is not None and mapped.dtype == "|u1" and len(numbers) >= width:
        return mapped
    return table.converted(numbers, Column(spill(name), "|u1", 4))
