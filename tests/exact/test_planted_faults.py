"""Faults planted in a copy of the package, one at a time: these tests notice each of them.

A fault is one replacement of text that occurs once in its file, so that the table cannot rot. The
copy is run with a cache of kernels that holds nothing compiled from the changed file; were it
stale, the fault would go unnoticed and fail the test here.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[2]
COPIED = ("pyproject.toml", "gstream", "tests/conftest.py", "tests/exact", "tests/e2e/meshes.py")

MILLIONS = "test_exact_counts.py::test_millions_of_voxels_are_set_as_the_oracle_sets_them"
SETS = "test_exact_sets.py::test_the_voxels_of_a_triangle_are_the_exact_ones"
AREA = "test_exact_sets.py::test_the_area_of_a_fragment_is_the_exact_one"
NORMAL = "test_exact_sets.py::test_mask_and_area_vector_follow_the_exact_normal"
CHANNEL = "test_exact_sets.py::test_a_linear_channel_takes_its_mean_over_each_fragment"
SUM = "test_exact_sets.py::test_a_soup_is_the_sum_of_its_triangles"
BOXES = (
    "test_exact_spanning.py::test_a_spanning_triangle_is_the_same_through_boxes_of_256_and_of_128"
)
GHOST = (
    "test_exact_spanning.py::"
    "test_there_is_no_second_surface_where_the_plane_value_is_zero_modulo_2_to_the_64"
)
SNAPPED = "test_hard_streams.py::test_millimetres_at_10000_kilometres_are_snapped_once_and_right"
BORDERS = (
    "test_hard_voxels.py::test_what_touches_the_borders_of_cells_is_counted_once_whatever_the_cell"
)
FULL = "test_hard_levels.py::test_blocks_of_256_hold_their_first_their_last_and_all_of_their_voxels"
DRIFT = "test_hard_attributes.py::test_the_drift_of_a_colour_over_14_levels_is_half_a_code_a_level"


@dataclass(frozen=True, slots=True)
class Fault:
    name: str
    file: str  # below gstream/kernels/
    old: str
    new: str
    test: str  # below tests/exact/: notices the fault


FAULTS = (
    Fault(
        "small triangles: an edge lies one snap unit too far in", "packet_overlap.py",
        "np.int32((c + ((max(a, 0) + max(b, 0)) << k)) >> k)",
        "np.int32((c + ((max(a, 0) + max(b, 0)) << k) - 1) >> k)", MILLIONS,
    ),
    Fault(
        "small triangles: the wrong projection takes ties by its second axis", "packet_overlap.py",
        "q_first = turned(words[at(FIRST_AXIS, lane)], axis) == 1",
        "q_first = turned(words[at(FIRST_AXIS, lane)], axis) == 0", MILLIONS,
    ),
    Fault(
        "small triangles: a plane on the voxel's corner meets it from either side",
        "packet_frame.py",
        "((-value - np.int64(first > 0)) >> k)", "(-value >> k)", SETS,
    ),
    Fault(
        "small triangles: a plane on a segment's end meets it from either side",
        "packet_overlap.py",
        "over = max(n, 0) + ((middle - np.int64(first > 0)) >> k)",
        "over = max(n, 0) + (middle >> k)", SETS,
    ),
    Fault(
        "small triangles: the last voxels of the room are left out", "packet_overlap.py",
        "pick(which, room[0], room[1], room[2]) - 1 - place",
        "pick(which, room[0], room[1], room[2]) - 2 - place", MILLIONS,
    ),
    Fault(
        "small triangles: codes of shapes are read without their turns", "packets.py",
        "EDGE - 1 - this_long if this_deep & 1 else this_long", "this_long", MILLIONS,
    ),
    Fault(
        "small triangles: sorting the corners turns the normal", "packet_frame.py",
        "words[at(TURN, lane)] = 1 - 2 * (swaps & 1)", "words[at(TURN, lane)] = 1", NORMAL,
    ),
    Fault(
        "areas of small triangles: the layer above gets the wrong sign", "cover.py",
        "beyond[above] -= reals[at(BEYOND, lane)]", "beyond[above] += reals[at(BEYOND, lane)]",
        AREA,
    ),
    Fault(
        "areas of small triangles: a moment is a fifth too large", "cover.py",
        "(r0 * r0 + r0 * r1 + r1 * r1) / 6.0", "(r0 * r0 + r0 * r1 + r1 * r1) / 5.0", CHANNEL,
    ),
    Fault(
        "large triangles: a column counts as covered before it is", "fragments.py",
        "inside_0 > abs(a0) + abs(b0)", "inside_0 > abs(a0)", MILLIONS,
    ),
    Fault(
        "large triangles: closed ties leave out the voxel below a lattice plane", "fragments.py",
        "-((-low) >> k) - 1 - base if closed else 0", "0", MILLIONS,
    ),
    Fault(
        "large triangles: a full buffer loses a slab", "fragments.py",
        "return place, i, count", "return place, i + 1, count", BOXES,
    ),
    Fault(
        "large triangles: the area below a voxel is taken from the wrong height", "fragments.py",
        "measured = l + 1", "measured = l + 2", AREA,
    ),
    Fault(
        "large triangles: inside, a target is met below its low end", "fragments.py",
        "value + over_u >= 0 and value + under_u <= 0", "value + under_u <= 0", MILLIONS,
    ),
    Fault(
        "areas of large triangles: a corner of a square counts twice", "clip.py",
        "0.5 / gentle if", "1.0 / gentle if", AREA,
    ),
    Fault(
        "areas of large triangles: layers gain what they should lose", "outline.py",
        "own[place + np.uint64(above)] -= piece", "own[place + np.uint64(above)] += piece", AREA,
    ),
    Fault(
        "planes: the ceiling forgets the tie rule", "overlap.py",
        "whole - ((-fraction - up) >> k)", "whole - (-fraction >> k)", MILLIONS,
    ),
    Fault(
        "planes: half a unit is lost where a centre lies between two", "overlap.py",
        "odd = half * (across & 1)", "odd = 0", MILLIONS,
    ),
    Fault(
        "planes: the last voxel of a column is a float's guess", "overlap.py",
        "    while last < size - 1 and below + n * (last + 1) <= 0:\n        last += 1\n", "", SETS,
    ),
    Fault(
        "planes: values that leave 64 bits are taken as they are", "overlap.py",
        "abs(estimate) > 2.0**62", "abs(estimate) > 2.0**80", GHOST,
    ),
    Fault(
        "edges: the projection of a segment is its first edge", "overlap.py",
        "longest, found = d, e", "longest, found = d, 0", SETS,
    ),
    Fault(
        "edges: ties seen along y go by z before x", "overlap.py",
        "first_sign(b, a, 0) if r == 1 else first_sign(a, b, 0)", "first_sign(a, b, 0)", MILLIONS,
    ),
    Fault(
        "targets: diagonals end too low", "targets.py",
        "ends[m, 2] = (total + abs(along)) >> 1", "ends[m, 2] = total >> 1", MILLIONS,
    ),
    Fault(
        "targets: segments in a triangle's plane are met wherever they end", "targets.py",
        "return n != 0 or closed_segment_meets(tri, k, r, voxel)", "return True", MILLIONS,
    ),
    Fault(
        "targets: a triangle of no area is in the plane of every diagonal", "targets.py",
        "return volume == 0", "return True", MILLIONS,
    ),
    Fault(
        "sums: a fragment may weigh nothing", "accumulate.py",
        "max(areas[here], 1.0)", "areas[here]", AREA,
    ),
    Fault(
        "sums: the last fragment alone tells faces and target", "accumulate.py",
        "flags[at] |= masks[t]", "flags[at] = masks[t]", SUM,
    ),
    Fault(
        "areas: a polygon is cut in the middle of its edges", "clip.py",
        "t = d_before / (d_before - d)", "t = 0.5", AREA,
    ),
    Fault(
        "snapping rounds down", "snap.py",
        "* scale + 0.5)", "* scale)", SNAPPED,
    ),
    Fault(
        "cells: a triangle that ends in the first voxel of a cell does not go there", "presort.py",
        "min(high, resolution - 1) >> cell_bits", "min(high - 1, resolution - 1) >> cell_bits",
        BORDERS,
    ),
    Fault(
        "levels: a parent has the faces of its last child", "lod.py",
        "out_mask[parents[i]] |= mask[i]", "out_mask[parents[i]] = mask[i]", FULL,
    ),
    Fault(
        "levels: colours are averaged as if areas were equal", "lod.py",
        "sums[m, c] += share * tables[0][colours[i, c]]",
        "sums[m, c] += tables[0][colours[i, c]]", DRIFT,
    ),
)  # fmt: skip


def failures(garden: Path, cache: Path, tests: set[str]) -> list[str]:
    """Run tests of the copy up to the first failure; its first line."""
    report = cache / "report.xml"
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
    command += [f"--junitxml={report}", *(f"tests/exact/{test}" for test in sorted(tests))]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "HYPOTHESIS_PROFILE": "ci"}
    done = subprocess.run(command, cwd=garden, env=environment, capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    cases = list(ElementTree.parse(report).iter("testcase"))
    assert cases
    assert not any(case.findall("error") for case in cases), done.stdout
    return [found.get("message", "") for case in cases for found in case.findall("failure")]


def compiled_from(file: str) -> set[str]:
    """The kernel modules whose compiled code holds code of a file: it, and all that import it."""
    folder = ROOT / "gstream" / "kernels"
    texts = {path.stem: path.read_text() for path in folder.glob("*.py")}
    known: set[str] = set()
    more = {Path(file).stem}
    while more:
        known |= more
        imports = [f"from gstream.kernels.{name} import" for name in more]
        more = {n for n, text in texts.items() if any(i in text for i in imports)} - known
    return known


@pytest.fixture(scope="module")
def garden(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package and its tests."""
    folder = tmp_path_factory.mktemp("garden")
    for name in COPIED:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(ROOT / name, target)
    return folder


@pytest.fixture(scope="module")
def compiled(garden: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cache of kernels that the tests leave when they pass, as they do without a fault."""
    cache = tmp_path_factory.mktemp("kernels")
    assert failures(garden, cache, {fault.test for fault in FAULTS}) == []
    return cache


@pytest.fixture
def planted(garden: Path, request: pytest.FixtureRequest) -> Iterator[Fault]:
    fault: Fault = request.param
    path = garden / "gstream" / "kernels" / fault.file
    text, stat = path.read_text(), path.stat()
    assert text.count(fault.old) == 1
    path.write_text(text.replace(fault.old, fault.new))
    yield fault
    path.write_text(text)
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # the compiled code is of this time


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_text_that_a_fault_replaces_occurs_once(fault):
    text = (ROOT / "gstream" / "kernels" / fault.file).read_text()
    assert text.count(fault.old) == 1


@pytest.mark.long
@pytest.mark.parametrize("planted", FAULTS, indirect=True, ids=lambda fault: fault.name)
def test_a_planted_fault_fails_its_test_by_an_assertion(planted, garden, compiled, tmp_path):
    stale = [f"{module}.*" for module in compiled_from(planted.file)]
    cache = tmp_path / "kernels"
    shutil.copytree(compiled, cache, ignore=shutil.ignore_patterns(*stale))
    found = failures(garden, cache, {planted.test})
    assert len(found) == 1
    assert found[0].startswith(("AssertionError", "assert ")), found
