"""The header of a PLY file: elements, their properties, where the body starts and its coding."""

import re
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from gstream.errors import InputError

MAX_HEADER = 1 << 20  # bytes; the longest seen in the wild is below 4 KiB
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
REMEDY = "export the PLY file again"
INDEX_LISTS = ("vertex_indices", "vertex_index")
FACES = ("face", "tristrips")


@dataclass(frozen=True, slots=True)
class Property:
    """One property; `count` is the type of a list's length, "" for a scalar."""

    name: str  # in lower case
    kind: str  # NumPy's spelling without byte order, such as "f4"
    count: str = ""


@dataclass(frozen=True, slots=True)
class Element:
    """One element: `rows` records of the same properties."""

    name: str
    rows: int
    properties: tuple[Property, ...]

    @property
    def fixed(self) -> bool:
        """Whether every record has the same size."""
        return not any(p.count for p in self.properties)

    @property
    def smallest(self) -> int:
        """Bytes of a binary record whose lists are all empty; of every record when `fixed`."""
        return sum(np.dtype(p.count or p.kind).itemsize for p in self.properties)

    def record(self, order: str) -> np.dtype[np.void]:
        """The packed dtype of a fixed element; fields are named by number, as names may repeat."""
        fields = [(str(i), order + p.kind) for i, p in enumerate(self.properties)]
        return np.dtype(fields)


@dataclass(frozen=True, slots=True)
class Header:
    order: str  # "<", ">", or "" for ascii
    elements: tuple[Element, ...]
    body: int  # byte at which the first element starts
    lines: int  # lines of the header, for the line numbers of an ascii body

    def element(self, name: str) -> Element | None:
        return next((e for e in self.elements if e.name == name), None)


def read_header(file: BinaryIO, name: str) -> Header:
    """Parse the header at the start of `file`; InputError names the line that breaks it.

    Lines of other words are comments, also when an exporter forgot to say so (old Blender did).
    """
    head = file.read(MAX_HEADER)
    magic = re.match(rb"ply[ \t]*(\r\n|\n|\r)", head)
    if magic is None:
        raise InputError(name, "line 1", "the first line is not 'ply'", REMEDY)
    order: str | None = None
    elements: list[Element] = []
    at, line = magic.end(), 1
    while True:
        stop = head.find(magic[1][-1:], at)
        if stop < 0:
            raise InputError(name, f"line {line}", "the header has no end_header", REMEDY)
        words = head[at:stop].decode("latin-1").split()
        at, line = stop + 1, line + 1
        match words:
            case ["end_header"]:
                break
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as coding, _]:
                order = ORDERS[coding]
            case ["element", element, rows] if rows.isdecimal():
                elements.append(Element(element, int(rows), ()))
            case ["property", *rest] if elements:
                last = elements[-1]
                added = (*last.properties, _property(rest, name, line))
                elements[-1] = Element(last.name, last.rows, added)
            case [("format" | "element" | "property"), *_]:
                said = f"cannot read {ascii(' '.join(words))[:60]} in the header"
                raise InputError(name, f"line {line}", said, REMEDY)
    if order is None:
        raise InputError(name, f"line {line}", "the header has no format line", REMEDY)
    return Header(order, tuple(elements), at, line)


def _property(words: list[str], name: str, line: int) -> Property:
    match words:
        case ["list", count, kind, label] if count in TYPES and kind in TYPES:
            return Property(label.lower(), TYPES[kind], TYPES[count])
        case [kind, label] if kind in TYPES:
            return Property(label.lower(), TYPES[kind])
    said = f"cannot read property {ascii(' '.join(words))[:60]}"
    raise InputError(name, f"line {line}", said, f"use one of {', '.join(list(TYPES)[:8])}")
