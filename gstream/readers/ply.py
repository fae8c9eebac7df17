"""PLY: what can be mapped is mapped, the rest is spilled by ply_spill."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gstream.errors import InputError
from gstream.readers.mesh import DiskArray, Mesh
from gstream.readers.ply_columns import COORDINATES, Table, attributes_of, colours_of, find
from gstream.readers.ply_header import (
    FACES,
    INDEX_LISTS,
    REMEDY,
    Element,
    Header,
    Property,
    read_header,
)
from gstream.readers.ply_spill import spill_ply
from gstream.readers.scratch import Spill

SCAN_ROWS = 1 << 18
GLANCE_ROWS = 4096  # faces that needs_spill looks at


def open_ply(path: Path, name: str, spill: Spill) -> Mesh:
    """The mesh of a PLY file: vertices and triangles mapped when the file lays them out so."""
    header, vertex = _header(path, name)
    vertices = vertex_table(header, path)
    faces = triangle_table(header, path)
    if vertices is None or faces is None or not _only_triangles(faces, faces.element.rows):
        return _with_edges(spill_ply(path, name, header, vertex, spill), header)
    rows = faces.element.rows
    positions, normals, colours = attributes_of(vertices, spill)
    mesh = Mesh(
        name,
        positions,
        triangles_of(faces),
        rows,
        normals=normals,
        colours=colours,
        triangle_colours=colours_of(faces, spill, "triangle_colours", 4),
        faces=rows,
    )
    return _with_edges(mesh, header)


def _with_edges(mesh: Mesh, header: Header) -> Mesh:
    edges = sum(e.rows for e in header.elements if e.name == "edge")
    return replace(mesh, skipped_faces=mesh.skipped_faces + edges)


def needs_spill(path: Path, name: str) -> bool:
    """Whether opening the file writes scratch; looks at the header and the first faces only."""
    header, _ = _header(path, name)
    vertices, faces = vertex_table(header, path), triangle_table(header, path)
    return vertices is None or faces is None or not _only_triangles(faces, GLANCE_ROWS)


def _header(path: Path, name: str) -> tuple[Header, Element]:
    with open(path, "rb") as file:
        header = read_header(file, name)
    vertex = check_elements(header, name)
    check_size(header, path.stat().st_size, name)
    return header, vertex


def check_elements(header: Header, name: str) -> Element:
    """The vertex element; InputError when it or faces that this reader knows are missing."""
    faces = [e for e in header.elements if e.name in FACES and e.rows]
    if not faces:
        said = "has no faces (no face or tristrips element with rows)"
        raise InputError(name, "header", said, "make triangles from the points first")
    vertex = header.element("vertex")
    if vertex is None or not find(vertex, COORDINATES):
        raise InputError(name, "header", "has no vertex element with x, y and z", REMEDY)
    for element in faces:
        if not any(p.count and p.name in INDEX_LISTS for p in element.properties):
            said = f"element {element.name} has no list vertex_indices"
            raise InputError(name, "header", said, REMEDY)
    return vertex


def check_size(header: Header, size: int, name: str) -> None:
    """Refuse a header that promises more than `size` bytes hold; nothing is allocated before."""
    there = size - header.body
    for element in header.elements:
        one = element.smallest if header.order else 2 * len(element.properties)
        if element.rows * one - (not header.order) > there:
            said = (
                f"the file ends inside element {element.name}: the header promises {element.rows}"
            )
            raise InputError(name, f"byte {size}", said, "copy the file again")
        there -= element.rows * one


def _offset(header: Header, name: str) -> int | None:
    """The byte at which element `name` starts, when only fixed records precede it."""
    at = header.body
    for element in header.elements:
        if element.name == name:
            return at
        if not element.fixed:
            return None
        at += element.rows * element.smallest
    return None


def vertex_table(header: Header, path: Path) -> Table | None:
    """The vertices where they lie; None when they must be read through."""
    vertex, at = header.element("vertex"), _offset(header, "vertex")
    if not header.order or vertex is None or at is None or not vertex.fixed:
        return None
    return Table(vertex, str(path.absolute()), at, header.order)


def triangle_table(header: Header, path: Path) -> Table | None:
    """The faces as records of a count and three ids; None when header or size rule that out."""
    faces = [e for e in header.elements if e.name in FACES and e.rows]
    at = _offset(header, faces[0].name)
    lists = [p for p in faces[0].properties if p.count]
    if not header.order or len(faces) > 1 or faces[0].name != "face" or at is None:
        return None
    if len(lists) > 1 or lists[0].kind[0] == "f" or lists[0].count[0] == "f":
        return None
    properties: list[Property] = []
    for p in faces[0].properties:
        ids = [replace(p, name=f"id {i}", count="") for i in range(3)]
        properties += [Property("count", p.count), *ids] if p.count else [p]
    element = Element("face", faces[0].rows, tuple(properties))
    if at + element.rows * element.smallest > path.stat().st_size:
        return None
    return Table(element, str(path.absolute()), at, header.order)


def _count_property(faces: Table) -> int:
    return next(i for i, p in enumerate(faces.element.properties) if p.name == "count")


def triangles_of(faces: Table) -> DiskArray:
    first = _count_property(faces) + 1
    column = faces.column((first, first + 1, first + 2))
    if column is None:
        raise TypeError("three ids of one list have one type and one gap")
    return column


def _only_triangles(faces: Table, rows: int) -> bool:
    """Whether the first `rows` lists have three entries each."""
    counts = faces.scalar(_count_property(faces)).map()[:rows]
    return all(
        bool(np.all(counts[i : i + SCAN_ROWS] == 3)) for i in range(0, len(counts), SCAN_ROWS)
    )
