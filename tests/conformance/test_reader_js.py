"""tools/reader_js under Node: its own tests, and its answers beside what gstream reads."""

import json
import os
import subprocess
from hashlib import blake2b
from pathlib import Path
from typing import Any

import pytest
from node import node
from small_block_files import Paging, file_bytes, random_scene

from gstream.check import check_file
from gstream.read import open_block_file

ROOT = Path(__file__).parents[2]
READER = ROOT / "tools" / "reader_js"
VECTORS = ROOT / "spec" / "vectors"
GOOD = sorted(VECTORS.glob("good/*.gsb"))
BAD = sorted(VECTORS.glob("bad/*.gsb"))
NOT_A_READERS = {  # notes; levels recomputed; content id; ledger
    "GSB-0412", "GSB-0503", "GSB-0504", "GSB-0505", "GSB-0506", "GSB-0507", "GSB-0508",
    "GSB-0509", "GSB-0601", "GSB-0602", "GSB-0603",
}  # fmt: skip


@pytest.fixture(scope="module")
def paged(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Files whose opening run is longer than the first request, by depth of the page table."""
    folder = tmp_path_factory.mktemp("paged")
    scene = random_scene(128, voxels=9000)
    written = {}
    for depth, paging in (("1", Paging()), ("2", Paging(head_records=2, table_records=2))):
        written[depth] = folder / f"depth-{depth}.gsb"
        written[depth].write_bytes(file_bytes(scene, paging=paging))
    return written


@pytest.fixture(scope="module")
def answers(paged: dict[str, Path]) -> dict[Path, dict[str, Any]]:
    """What the reader says of every vector, and of the two larger files."""
    paths = [*GOOD, *BAD, *paged.values()]
    ran = subprocess.run(
        [node(), READER / "conformance.mjs"],
        input="".join(f"{path}\n" for path in paths),
        capture_output=True,
        text=True,
        check=True,
    )
    lines = ran.stdout.splitlines()
    return dict(zip(paths, map(json.loads, lines), strict=True))


def test_the_readers_own_tests_pass(paged: dict[str, Path]) -> None:
    files = {f"GSB_DEPTH_{depth}": str(path) for depth, path in paged.items()}
    ran = subprocess.run(
        [node(), "--test", *sorted(map(str, READER.glob("test/*.test.mjs")))],
        env={**os.environ, **files},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout
    assert "skipped 0" in ran.stdout


def content_of(path: Path) -> dict[str, Any]:
    """Per level: blocks, voxels, and BLAKE2b of every column's decoded values in file order."""
    with open_block_file(path) as file:
        levels = []
        for level in range(file.levels):
            views = list(file.blocks(level))
            hashes = {name: blake2b(digest_size=16) for name in file.columns}
            for view in views:
                for name, digest in hashes.items():
                    digest.update(view.column(name).tobytes())
            columns = {name: digest.hexdigest() for name, digest in hashes.items()}
            counts = {"blocks": len(views), "voxels": sum(view.count for view in views)}
            levels.append({"level": level, **counts, "columns": columns})
        return {"levels": levels}


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.stem)
def test_a_good_vector_has_the_content_that_gstream_reads(path, answers) -> None:
    assert answers[path]["valid"]
    assert answers[path]["codes"] == []
    assert answers[path]["content"] == content_of(path)


@pytest.mark.parametrize("depth", ["1", "2"])
def test_larger_files_have_the_content_that_gstream_reads(depth, paged, answers) -> None:
    assert answers[paged[depth]]["content"] == content_of(paged[depth])


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_a_bad_vector_is_refused_by_a_rule_that_gstream_finds_broken(path, answers) -> None:
    answer = answers[path]
    if path.stem in NOT_A_READERS:
        assert answer["valid"]
    else:
        assert not answer["valid"]
        assert set(answer["codes"]) <= set(check_file(path).counts)
