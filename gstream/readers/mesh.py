"""One input mesh as arrays on disk: what every reader returns and the ingest stage slices."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from gstream.errors import InputError

ARRAYS = ("positions", "triangles", "normals", "colours", "triangle_colours")  # of a mesh


@dataclass(frozen=True, slots=True)
class DiskArray:
    """An array inside a file: nothing is read before `map()` is sliced."""

    path: str
    offset: int  # bytes from the start of the file to element [0, 0, ...]
    dtype: str  # NumPy's spelling with byte order, such as "<f4"
    shape: tuple[int, ...]
    strides: tuple[int, ...]  # bytes, none negative

    def map(self) -> npt.NDArray[Any]:
        """A read-only view of `shape` and `dtype`, in the file's byte order, over a memory map.

        Raises InputError when the file has become shorter than the array.
        """
        dtype = np.dtype(self.dtype)
        if 0 in self.shape:
            return np.zeros(self.shape, dtype)
        steps = zip(self.shape, self.strides, strict=True)
        end = self.offset + sum((n - 1) * step for n, step in steps) + dtype.itemsize
        size = os.stat(self.path).st_size
        if end > size:
            said = f"the file ends before byte {end}; it was longer when it was opened"
            raise InputError(self.path, f"byte {size}", said, "leave inputs alone while a job runs")
        data = np.memmap(self.path, np.uint8, "r", shape=(end,))
        view: npt.NDArray[Any] = np.ndarray(
            self.shape, dtype, buffer=data, offset=self.offset, strides=self.strides
        )
        return view


@dataclass(frozen=True, slots=True)
class Mesh:
    """One input mesh: indexed triangles, or a soup when `triangles` is None.

    A soup's positions are (t, 3, 3), triangle, corner, xyz: binary STL has no other strides.
    A file may have both `colours` and `triangle_colours`. A normal of (0, 0, 0) means that the
    file gave none.
    """

    name: str  # the input's path as the user gave it, for errors
    positions: DiskArray  # (v, 3) f4 or f8 in either byte order; (t, 3, 3) when `triangles` is None
    triangles: DiskArray | None  # (t, 3) vertex ids, any integer type; unchecked when mapped
    triangle_count: int
    normals: DiskArray | None = None  # (v, 3) f4 in either byte order, of any length
    colours: DiskArray | None = None  # (v, 3) or (v, 4) u1, sRGB codes
    triangle_colours: DiskArray | None = None  # (t, 4) u1, sRGB codes
    faces: int = 0  # faces as the file counts them
    skipped_faces: int = 0  # faces with fewer than 3 vertices, points, lines
    notes: Mapping[str, int] = field(default_factory=dict)  # what else was left out, and how often
    beside: tuple[str, ...] = ()  # absolute paths that the file names, read or looked for

    @property
    def vertex_count(self) -> int:
        rows = self.positions.shape[0]
        return rows if self.triangles is not None else 3 * rows

    def lies_in(self, path: str | os.PathLike[str]) -> bool:
        """Whether any of the arrays is in the file `path`."""
        arrays = [getattr(self, name) for name in ARRAYS]
        wanted = os.path.abspath(path)
        return any(a is not None and os.path.abspath(a.path) == wanted for a in arrays)

    def to_json(self) -> bytes:
        """All of it; paths are absolute, as a job may be resumed in another working folder."""
        fields = asdict(self)
        for key in ARRAYS:
            if fields[key] is not None:
                fields[key]["path"] = os.path.abspath(fields[key]["path"])
        return json.dumps(fields, sort_keys=True).encode()

    @classmethod
    def from_json(cls, data: bytes) -> Self:
        fields = json.loads(data)
        for key in ARRAYS:
            if fields[key] is not None:
                array = fields[key]
                array["shape"], array["strides"] = tuple(array["shape"]), tuple(array["strides"])
                fields[key] = DiskArray(**array)
        return cls(**{**fields, "beside": tuple(fields["beside"])})
