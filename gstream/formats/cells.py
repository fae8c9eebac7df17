"""Cells on disk: what presort leaves for voxelize. Scratch, no public format.

Each presort unit leaves one file of segments, each of one cell and kind. A small segment: vertices
(u64, kernels/presort.py), triangles (3 x u16), attribute words (u32, per corner); a large one:
corners (9 x i32), attribute words. The index of all segments is one array; the scene (grid,
attributes, counts) is one JSON file.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np

from gstream.grid import Box, Grid, grid_of
from gstream.job import VoxelizeSettings

SCENE = "scene.json"
SEGMENTS = "segments.npy"
SMALL, LARGE = 0, 1
SEGMENT = np.dtype(
    [
        ("cell", "<u4"),  # Morton code of the cell
        ("kind", "u1"),  # SMALL or LARGE
        ("unit", "<u4"),  # number of the presort unit whose file holds the segment
        ("count", "<u4"),  # triangles
        ("vertices", "<u4"),  # of a small segment; a large one has three corners a triangle
        ("offset", "<u8"),  # bytes into that file
    ]
)


@dataclass(frozen=True, slots=True)
class Scene:
    """What every later stage must know of the input."""

    grid: Grid
    cell_bits: int  # log2 of the cell's edge in voxels
    colours: bool
    normals: bool  # input normals are used instead of the geometric ones
    box: Box  # of all stored vertices, world units
    metadata: Mapping[str, Any]  # of the stream: units, up, crs
    counts: Mapping[str, int]  # ledger so far
    weighted: bool = True  # voxels carry their area: something is averaged by it, or it is kept
    normal_column: bool = True  # voxels have normals, wherever these are from

    @property
    def cells(self) -> int:
        """Cells along each axis of the grid."""
        return ((self.grid.resolution - 1) >> self.cell_bits) + 1

    @property
    def columns(self) -> frozenset[str]:
        """What blocks have while levels are made: the weight too, unless nothing needs it."""
        held = {"normal": self.normal_column, "colour": self.colours, "weight": self.weighted}
        return frozenset({"occupancy", "mask", *(name for name, there in held.items() if there)})

    @property
    def words(self) -> int:
        """Attribute words (u32) at each corner."""
        return (1 if self.colours else 0) + (2 if self.normals else 0)

    @property
    def channels(self) -> int:
        """Attribute channels that the voxels sum up."""
        return (4 if self.colours else 0) + (3 if self.normals else 0)

    @property
    def cropped(self) -> bool:
        """The grid does not hold the whole scene."""
        low, high = self.box
        top = [o + self.grid.resolution * self.grid.voxel_size for o in self.grid.origin]
        return any(l < o for l, o in zip(low, self.grid.origin, strict=True)) or any(
            h > t for h, t in zip(high, top, strict=True)
        )

    def to_json(self) -> str:
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        record = json.loads(text)
        grid = record.pop("grid")
        low, high = record.pop("box")
        return cls(
            grid=Grid(**{**grid, "origin": tuple(grid["origin"])}),
            box=(tuple(low), tuple(high)),
            **record,
        )


def grid_of_stream(box: Box, metadata: Mapping[str, Any], settings: VoxelizeSettings) -> Grid:
    """The grid of a stream: its declared bounds, or else the box of its vertices.

    errors : UsageError as of grid_of
    """
    bounds = metadata.get("bounds")
    corners = (tuple(bounds[:3]), tuple(bounds[3:])) if bounds else None
    size = settings.voxel_size
    return grid_of(settings.resolution, size, box, corners, settings.snap_bits)
