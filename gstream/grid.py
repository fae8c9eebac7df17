"""The grid: where the voxels stand in the world, and how finely vertices are snapped to them.

Source: architecture.md section 4; the snap budget L + k <= 26 keeps every exact test in int64.
"""

from dataclasses import dataclass
from math import ceil, floor, isfinite

from gstream.errors import SceneError, UsageError

MAX_RESOLUTION = 65_536
MAX_SNAP_BITS = 12
COORDINATE_BITS = 26  # L + k: normals stay within 2^52, plane values of a 256^3 cell within 2^62
MIN_SNAP_BITS = 6
LEAST_EXTENT = 2.0**-40  # of the farthest coordinate: its rounding stays within the grid's margin

BEYOND_DOUBLE = ("the scene's extent is beyond double precision", "scale the scene")

Point = tuple[float, float, float]
Box = tuple[Point, Point]  # low and high corner


@dataclass(frozen=True, slots=True)
class Grid:
    """A cube of voxels in the world: world = origin + voxel_size * index."""

    resolution: int  # N, voxels per axis
    voxel_size: float  # edge of a finest voxel, world units
    origin: Point  # world position of the low corner of voxel (0, 0, 0)
    snap_bits: int  # k: vertices are snapped to voxel_size / 2^k

    @property
    def matrix(self) -> tuple[float, ...]:
        """Index -> world as a row-major 3 x 4 matrix."""
        h, (x, y, z) = self.voxel_size, self.origin
        return (h, 0.0, 0.0, x, 0.0, h, 0.0, y, 0.0, 0.0, h, z)

    def level_count(self, block_edge: int) -> int:
        """Levels from the finest down to a single block of block_edge^3 voxels."""
        blocks = -(-self.resolution // block_edge)
        return 1 + (blocks - 1).bit_length()


def grid_of(
    resolution: int | None,
    voxel_size: float | None,
    box: Box,
    bounds: Box | None = None,
    snap_bits: int | None = None,
) -> Grid:
    """The grid of a scene with the given box, or of its part inside `bounds` where given.

    snap_bits : k, or None for as many as `most_snap_bits` allows
    errors : UsageError for a grid that cannot be, with the limit; SceneError where no grid can
    """
    low, high = bounds or box
    if resolution is not None:
        return grid_of_resolution(low, high, resolution, box, snap_bits)
    if voxel_size is not None:
        return grid_of_voxel_size(low, high, voxel_size, box, snap_bits)
    raise UsageError("neither a resolution nor a voxel size is given", "give one of the two")


def grid_of_resolution(
    low: Point, high: Point, resolution: int, scene: Box, snap_bits: int | None = None
) -> Grid:
    """The cube of resolution^3 voxels centred on the box, 2^-10 wider than its largest extent.

    scene: the box of everything that will be snapped, which may reach beyond low..high.
    """
    if not 1 <= resolution <= MAX_RESOLUTION:
        raise UsageError(
            f"--resolution {resolution} is out of range",
            f"give 1 to {MAX_RESOLUTION} voxels per axis",
        )
    extent = max(h - l for l, h in zip(low, high, strict=True))
    farthest = max(abs(c) for c in (*low, *high))
    if 0 < extent < farthest * LEAST_EXTENT:
        raise SceneError(
            "the scene's extent is below the precision of coordinates this far out",
            "move the scene to the origin",
        )
    voxel_size = extent * (1 + 2.0**-10) / resolution if extent > 0 else 1.0
    reach = voxel_size * resolution / 2
    x, y, z = ((l / 2 + h / 2) - reach for l, h in zip(low, high, strict=True))
    return _snapped(resolution, voxel_size, (x, y, z), scene, snap_bits)


def grid_of_voxel_size(
    low: Point, high: Point, voxel_size: float, scene: Box, snap_bits: int | None = None
) -> Grid:
    """The smallest cube on the lattice of multiples of voxel_size that holds low..high."""
    if not (isfinite(voxel_size) and voxel_size > 0):
        raise UsageError(f"--voxel-size {voxel_size} is out of range", "give a positive length")
    if max(abs(c) for c in (*low, *high)) / voxel_size > 2.0**52:
        raise UsageError(
            f"--voxel-size {voxel_size} is below the precision of coordinates this far out",
            "give a larger voxel size, or move the scene to the origin",
        )
    first = [floor(l / voxel_size) for l in low]
    # A point just below a border snaps up to it, into the next voxel.
    last = [floor(h / voxel_size + 2.0 ** -(MIN_SNAP_BITS + 1)) for h in high]
    resolution = max(b - a + 1 for a, b in zip(first, last, strict=True))
    if resolution > MAX_RESOLUTION:
        least = max(h - l for l, h in zip(low, high, strict=True)) / (MAX_RESOLUTION - 2)
        raise UsageError(
            f"--voxel-size {voxel_size} needs {resolution} voxels per axis, above {MAX_RESOLUTION}",
            f"give at least {least:.6g}",
        )
    x, y, z = (a * voxel_size for a in first)
    return _snapped(resolution, voxel_size, (x, y, z), scene, snap_bits)


def most_snap_bits(reach: int) -> int:
    """The largest k where coordinates span `reach` voxels."""
    bits = max(1, (reach - 1).bit_length())
    return min(MAX_SNAP_BITS, COORDINATE_BITS - bits)


def check_snap_bits(snap_bits: int, reach: int) -> None:
    """errors : UsageError where k is over the budget of coordinates that span `reach` voxels."""
    most = most_snap_bits(reach)
    if not 1 <= snap_bits <= most:
        raise UsageError(
            f"--snap-bits {snap_bits} is out of range: coordinates span {reach} voxels, and their "
            f"bits and these are at most {COORDINATE_BITS} together",
            f"give 1 to {most}, or fewer voxels",
        )


def _snapped(
    resolution: int, voxel_size: float, origin: Point, scene: Box, snap_bits: int | None
) -> Grid:
    if not (isfinite(voxel_size) and voxel_size > 0 and all(map(isfinite, origin))):
        raise SceneError(*BEYOND_DOUBLE)
    reach = [resolution]
    for axis in range(3):
        first = min(0.0, (scene[0][axis] - origin[axis]) / voxel_size)
        last = max(float(resolution), (scene[1][axis] - origin[axis]) / voxel_size)
        reach.append(ceil(last - first))
    if most_snap_bits(max(reach)) < MIN_SNAP_BITS:
        raise UsageError(
            f"the scene reaches over {max(reach)} voxels, far beyond its --bounds",
            "widen --bounds, crop the scene, or use larger voxels",
        )
    if snap_bits is None:
        snap_bits = most_snap_bits(max(reach))
    check_snap_bits(snap_bits, max(reach))
    if not isfinite(2.0**snap_bits / voxel_size):
        raise SceneError(*BEYOND_DOUBLE)
    return Grid(resolution, voxel_size, origin, snap_bits)
