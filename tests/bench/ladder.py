"""The size ladder: which meshes are voxelized at which resolutions."""

from collections.abc import Mapping
from dataclasses import dataclass

# Mean edge * sqrt(triangles) / largest extent of the rough sphere: 3.31, 3.45, 3.54 measured with
# 20,000, 200,000 and 1,000,000 triangles; finer ones show more of the relief.
EDGE_CONSTANT = 3.5


@dataclass(frozen=True, slots=True)
class Step:
    """One run: voxels per axis, and the edge in voxels that this was chosen for."""

    resolution: int
    edge: float | None = None


@dataclass(frozen=True, slots=True)
class Ladder:
    """Rough spheres, and one triangle that spans its scene."""

    resolutions: Mapping[int, tuple[int, ...]]  # of the sphere of that many triangles
    edges: tuple[float, ...]  # mean edges in voxels, of every sphere
    edges_up_to: int  # voxels per axis; longer edges are left out
    span: tuple[int, ...]  # resolutions of the one triangle

    def steps(self, triangles: int) -> list[Step]:
        """The runs of one sphere, coarsest first."""
        chosen = [Step(resolution_of_edge(triangles, edge), edge) for edge in self.edges]
        steps = [step for step in chosen if step.resolution <= self.edges_up_to]
        steps += [Step(resolution) for resolution in self.resolutions[triangles]]
        return sorted(steps, key=lambda step: step.resolution)


def resolution_of_edge(triangles: int, edge: float) -> int:
    """Voxels per axis at which the sphere's mean edge is about `edge` voxels."""
    return max(1, round(edge * triangles**0.5 / EDGE_CONSTANT))


LADDERS = {
    "small": Ladder(
        resolutions={200_000: (), 1_000_000: (1024, 2048), 4_000_000: ()},
        edges=(0.3, 1, 3, 10),
        edges_up_to=2048,
        span=(1024, 4096),
    ),
    "large": Ladder(
        resolutions={
            1_000_000: (1024, 2048, 4096),
            10_000_000: (1024, 2048, 4096, 8192),
            30_000_000: (2048, 4096, 8192, 16384),
            100_000_000: (4096, 8192),
        },
        edges=(0.3, 1, 3, 10),
        edges_up_to=10_000,
        span=(1024, 2048, 4096, 8192, 16384),
    ),
}
