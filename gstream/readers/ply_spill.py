"""PLY that cannot be mapped whole: ascii, polygons, strips and lists are read through once."""

from pathlib import Path

from gstream.kernels import records as kernel
from gstream.readers import ply_columns
from gstream.readers.mesh import DiskArray, Mesh
from gstream.readers.number_source import BinaryNumbers, TextNumbers
from gstream.readers.ply_columns import COLOURS, COORDINATES, NORMALS, Table, as_codes, find
from gstream.readers.ply_header import FACES, INDEX_LISTS, Element, Header
from gstream.readers.record_walk import Plan, append_repeated, walk
from gstream.readers.scratch import Column, Spill
from gstream.readers.text_blocks import TextBlocks

ROLES = {"face": kernel.FAN, "tristrips": kernel.STRIP}


def spill_ply(path: Path, name: str, header: Header, vertex: Element, spill: Spill) -> Mesh:
    """Read the body once, element by element; fixed binary vertices stay where they are."""
    with open(path, "rb") as file:
        file.seek(header.body)
        body = _Body(path, name, header, vertex, spill)
        body.source = (
            BinaryNumbers(file, name, header.order)
            if header.order
            else TextNumbers(TextBlocks(file, name, header.lines + 1), hashes=False)
        )
        wanted = [i for i, e in enumerate(header.elements) if e is vertex or e.name in FACES]
        for element in header.elements[: wanted[-1] + 1]:
            if element is vertex:
                body.read_vertices()
            elif element.name in FACES:
                body.read_faces(element)
            else:
                body.pass_over(element)
    return body.mesh()


class _Body:
    """The walk over one body and the columns it fills."""

    source: BinaryNumbers | TextNumbers

    def __init__(
        self, path: Path, name: str, header: Header, vertex: Element, spill: Spill
    ) -> None:
        self.path, self.name, self.header, self.spill = path, name, header, spill
        self.vertex = vertex
        self.triangles = Column(spill("triangles"), "<u4" if vertex.rows < 1 << 32 else "<u8", 3)
        self.vertex_arrays: tuple[DiskArray, DiskArray | None, DiskArray | None] | None = None
        self.triangle_colours: Column | None = None
        self.faces = self.skipped = 0

    def plan(self, element: Element, fields: tuple[int, ...], role: int) -> Plan:
        """Capture the scalars `fields`, in that order, and give index lists `role`."""
        roles = tuple(
            kernel.SCALAR if not p.count else role if p.name in INDEX_LISTS else kernel.LIST
            for p in element.properties
        )
        slots = [-1] * len(roles)
        for slot, number in enumerate(fields):
            slots[number] = slot
        whole = not self.header.order
        columns = len(fields)
        rows, vertices = element.rows, self.vertex.rows
        return Plan(element.name, rows, roles, tuple(slots), columns, vertices, whole)

    def read_vertices(self) -> None:
        vertex, spill = self.vertex, self.spill
        if self.header.order and vertex.fixed and isinstance(self.source, BinaryNumbers):
            table = Table(vertex, str(self.path.absolute()), self.source.tell, self.header.order)
            self.vertex_arrays = ply_columns.attributes_of(table, spill)
            self.source.tell += vertex.rows * vertex.smallest
            return
        self.source.begin(vertex)
        self.vertex_arrays = self._walk_vertices()

    def _walk_vertices(self) -> tuple[DiskArray, DiskArray | None, DiskArray | None]:
        vertex, spill = self.vertex, self.spill
        places, normals = find(vertex, COORDINATES), find(vertex, NORMALS)
        colours = find(vertex, COLOURS)
        kinds = [p.kind for p in vertex.properties]
        painted = [kinds[i] for i in colours]
        single = all(kinds[i] == "f4" for i in places)
        xyz = Column(spill("positions"), "<f4" if single else "<f8", 3)
        directions = Column(spill("normals"), "<f4", 3) if normals else None
        codes = Column(spill("colours"), "|u1", 4) if colours else None
        first = 6 if normals else 3
        plan = self.plan(vertex, places + normals + colours, kernel.LIST)
        for batch in walk(self.source, plan, self.name):
            rows = batch.captured
            xyz.append(rows[:, :3])
            if directions is not None:
                directions.append(rows[:, 3:6])
            if codes is not None:
                codes.append(as_codes(list(rows[:, first:].T), painted))
        return (
            xyz.close(),
            directions.close() if directions is not None else None,
            codes.close() if codes is not None else None,
        )

    def read_faces(self, element: Element) -> None:
        only = sum(e.rows > 0 for e in self.header.elements if e.name in FACES) == 1
        fields = find(element, COLOURS) if only and element.rows else ()
        kinds = [element.properties[i].kind for i in fields]
        if fields:
            self.triangle_colours = Column(self.spill("triangle_colours"), "|u1", 4)
        self.source.begin(element)
        skipped = 0
        for batch in walk(self.source, self.plan(element, fields, ROLES[element.name]), self.name):
            self.triangles.append(batch.triangles)
            skipped = batch.skipped
            if self.triangle_colours is not None:
                codes = as_codes(list(batch.captured.T), kinds)
                append_repeated(self.triangle_colours, codes, batch.made)
        self.faces += element.rows
        self.skipped += skipped

    def pass_over(self, element: Element) -> None:
        if element.fixed and isinstance(self.source, BinaryNumbers):
            self.source.tell += element.rows * element.smallest
            return
        self.source.begin(element)
        for _ in walk(self.source, self.plan(element, (), kernel.LIST), self.name):
            pass

    def mesh(self) -> Mesh:
        if self.vertex_arrays is None:
            raise TypeError("a header without vertices was let through")
        positions, normals, colours = self.vertex_arrays
        triangles = self.triangles.close()
        painted = self.triangle_colours
        return Mesh(
            self.name,
            positions,
            triangles,
            triangles.shape[0],
            normals=normals,
            colours=colours,
            triangle_colours=painted.close() if painted is not None else None,
            faces=self.faces,
            skipped_faces=self.skipped,
        )
