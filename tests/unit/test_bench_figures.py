"""What the benchmarks compute from their measurements, beside values computed by hand."""

import math
from itertools import islice

import numpy as np
import pytest

from tests.bench.figures import DiskRate, PowerLaw, least_seconds, power_law
from tests.bench.ladder import Ladder, Step, resolution_of_edge
from tests.bench.meshes import Sphere
from tests.bench.runs import Run
from tests.bench.slopes import slopes
from tests.bench.tables import (
    disk_table,
    peer_table,
    share_table,
    slope_table,
    speed_table,
    stage_table,
)


def stage(name: str, cpu: float, read: int, written: int) -> dict[str, object]:
    """Half a second of wall time and two units that took 0.75 s in all."""
    return {
        "stage": name,
        "units": 2,
        "seconds": 0.5,
        "warm_seconds": 9.0,
        "unit_seconds": 0.75,
        "cpu_seconds": cpu,
        "read_bytes": read,
        "written_bytes": written,
        "disk_read_bytes": 0,
        "disk_written_bytes": 0,
        "peak_memory": 5 << 20,
    }


def run_of(triangles: int, cpu: float, **changed: object) -> Run:
    """A voxelization at 1024^3 of 40 MB into 20 MB, by way of 10 MB of scratch."""
    values = {
        "mesh": f"sphere {triangles}",
        "command": "voxelize",
        "resolution": 1024,
        "edge": None,
        "triangles": triangles,
        "voxels": 4 * triangles,
        "workers": 2,
        "cpu_s": cpu,
        "wall_s": 3.0,
        "peak_bytes": 100 << 20,
        "input_bytes": 40_000_000,
        "scratch_bytes": 10_000_000,
        "output_bytes": 20_000_000,
        "estimated_bytes": 33_000_000,
        "read_bytes": 55_000_000,
        "written_bytes": 31_000_000,
        "disk_read_bytes": 1_000_000,
        "disk_written_bytes": 32_000_000,
        "stages": (
            stage("3-presort", cpu / 4, 40_000_000, 10_000_000),
            stage("4-voxelize", cpu / 2, 10_000_000, 20_000_000),
        ),
    }
    return Run(**(values | changed))  # type: ignore[arg-type]


RATE = DiskRate(read=100e6, write=50e6)


def test_a_power_law_is_found_again() -> None:
    law = power_law((x, 3 * x**0.75) for x in (1, 16, 81, 256))
    assert law is not None
    assert law.slope == pytest.approx(0.75)
    assert law.factor == pytest.approx(3)
    assert law.at(10_000) == pytest.approx(3000)


def test_points_off_the_line_are_fitted_by_least_squares() -> None:
    # logs (0, 0), (1, 1), (2, 4): slope (5/3 + 7/3) / 2, intercept 5/3 - 2
    law = power_law([(1, 1), (math.e, math.e), (math.e**2, math.e**4)])
    assert law is not None
    assert law.slope == pytest.approx(2)
    assert law.factor == pytest.approx(math.exp(-1 / 3))


@pytest.mark.parametrize("points", [[], [(5, 1)], [(5, 1), (5, 2)], [(5, 1), (7, 0), (0, 3)]])
def test_fewer_than_two_sizes_have_no_law(points: list[tuple[float, float]]) -> None:
    assert power_law(points) is None


def test_the_lower_bound_moves_scratch_both_ways_and_the_rest_once() -> None:
    # (1000 + 500) / 200 + (500 + 250) / 100
    assert least_seconds(DiskRate(read=200, write=100), 1000, 500, 250) == 15


@pytest.mark.parametrize(("triangles", "edge"), [(20_000, 1), (20_000, 10), (200_000, 3)])
def test_the_sphere_has_the_edges_that_the_ladder_asks_for(triangles: int, edge: float) -> None:
    sphere = Sphere.of_triangles(triangles)
    corners = sphere.vertices(0, sphere.m + 1)[sphere.faces(0, sphere.m)].astype(np.float64)
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    voxel = np.ptp(corners.reshape(-1, 3), axis=0).max() / resolution_of_edge(triangles, edge)
    assert lengths.mean() / voxel == pytest.approx(edge, rel=0.08)


def test_a_sphere_is_voxelized_from_coarse_to_fine_and_not_beyond_the_ladder() -> None:
    ladder = Ladder({12_250_000: (512, 2048)}, edges=(0.5, 1, 3), edges_up_to=1000, span=())
    # sqrt(12,250,000) is 3500, and 3.5 is the sphere's: an edge of 1 at 1000
    assert ladder.steps(12_250_000) == [Step(500, 0.5), Step(512), Step(1000, 1), Step(2048)]


def test_a_slope_is_of_one_edge_and_told_with_and_without_the_start() -> None:
    runs = [run_of(1000, 3, edge=1.0), run_of(4000, 9, edge=1.0), run_of(4000, 5, edge=3.0)]
    starts = {"voxelize in one process": 77.0, "voxelize with workers": 1.0}
    (found,) = (slope for slope in slopes(runs, starts) if slope.unit == "triangles")
    assert (found.what, found.smallest, found.largest) == ("voxelize, edge 1", 1000, 4000)
    assert found.law.slope == pytest.approx(math.log(3) / math.log(4))
    assert found.net == PowerLaw(pytest.approx(1), pytest.approx(0.002))  # 2 s and 8 s


def test_a_run_has_started_workers_where_a_stage_has_several_units() -> None:
    alone = tuple(found | {"units": 1} for found in run_of(1000, 1).stages)
    assert run_of(1000, 1).start == "voxelize with workers"
    assert run_of(1000, 1, workers=0).start == "voxelize in one process"
    assert run_of(1000, 1, stages=alone).start == "voxelize in one process"


def test_a_slope_against_voxels_is_of_one_mesh() -> None:
    runs = [run_of(1000, 1, voxels=100), run_of(1000, 100, voxels=10_000), run_of(2000, 7)]
    (found,) = (slope for slope in slopes(runs, {}) if slope.unit == "voxels")
    assert (found.what, found.runs, found.law.slope) == ("voxelize sphere 1000", 2, 1.0)


def test_shares_are_of_the_whole_command_and_leave_the_start() -> None:
    run = run_of(1000, 8)
    assert run.shares == {"start": 0.25, "3-presort": 0.25, "4-voxelize": 0.5}
    assert share_table([run]).splitlines()[-1].endswith("| 25% | 50% | 25% |")


def last_row(table: str) -> str:
    return table.splitlines()[-1]


def test_speed_is_per_cpu_second_and_size_per_triangle_and_voxel() -> None:
    run = run_of(2_000_000, 4, edge=3.0)
    expected = "8,000,000 | 4.00 | 3.00 | 0.500 | 2.000 | 5.0 | 10.0 | 2.50 | 100 |"
    label = "| voxelize sphere 2000000 at 1024^3, edge 3 | "
    assert last_row(speed_table([run], 1 << 30)) == label + expected


def test_a_peak_above_the_promise_is_pointed_out() -> None:
    assert "100 ABOVE --memory |" in last_row(speed_table([run_of(1000, 1)], 99 << 20))


def test_the_bound_is_over_the_measured_rate() -> None:
    # (40 + 10) MB at 100 MB/s and (10 + 20) MB at 50 MB/s: 1.1 s, of 3; 33 MB told, 30 used
    expected = "| 50.0 + 30.0 | 55.0 | 31.0 | 1.0 | 32.0 | 1.100 | 2.7 | 1.10 |"
    assert last_row(disk_table([run_of(1000, 1)], RATE)).endswith(expected)


def test_a_stage_is_beside_what_its_bytes_need_and_what_its_workers_could() -> None:
    # 10 MB at 100 MB/s and 20 MB at 50; 0.75 s of units in 0.5 s of two workers
    expected = "| 4-voxelize | 0.50 | 0.80 | 0.40 | 75% | 10.0 | 20.0 | 0.500 | 1.0 | 5 |"
    assert last_row(stage_table(run_of(1000, 1.6), RATE)) == expected


def test_nothing_is_extrapolated_from_less_than_a_fortieth() -> None:
    def told(largest: int) -> str:
        # 2 s a million triangles: 10^9 take 2,000 s
        runs = [run_of(size, size * 2e-6, edge=1.0) for size in (1_000_000, largest)]
        return last_row(slope_table(islice(slopes(runs, {}), 1)))

    assert told(25_000_000).endswith("| 1.000 | 1.000 | 2,000 |")
    assert told(24_000_000).endswith("| 1.000 | 1.000 |  |")


def test_a_peer_is_compared_in_voxels_per_cpu_second() -> None:
    run = run_of(1_000_000, 2)
    peer = {"what": "p", "voxels": 5_000_000, "cpu_s": 20, "wall_s": 21, "peak_bytes": 7 << 20}
    failed = {"what": "q", "error": "exit code 1: no"}
    rows = peer_table([peer | {"ours": run}, failed | {"ours": run}]).splitlines()[-3:]
    mesh = "| sphere 1000000 at 1024^3 |"
    assert rows == [
        f"{mesh} gstream | 4,000,000 | 2.00 | 3.00 | 2.000 | 100 |  |",
        f"{mesh} p | 5,000,000 | 20.00 | 21.00 | 0.250 | 7 | 8.0 |",
        f"{mesh} q | exit code 1: no |  |  |  |  |  |",
    ]
