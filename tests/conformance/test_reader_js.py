"""tools/reader_js under Node: its own tests, and its answers beside those of readers in Python.

It reads no expected verdict: gstream, `gstream check` and the reference decoder are asked here.
"""

import json
import os
import subprocess
from collections.abc import Sequence
from hashlib import blake2b
from pathlib import Path
from runpy import run_path
from typing import Any

import pytest
from node import node
from small_block_files import Paging, file_bytes, random_scene

from fuzz.mutants import mutant
from gstream.check import check_file
from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.columns import COLUMN_IDS
from gstream.formats.findings import ERROR
from gstream.formats.pieces import PIECE_IDS
from gstream.formats.stream import StreamReader
from gstream.read import open_block_file

ROOT = Path(__file__).parents[2]
READER = ROOT / "tools" / "reader_js"
VECTORS = ROOT / "spec" / "vectors"
GOOD = sorted(VECTORS.glob("good/*.gs[bt]"))
BAD = sorted(VECTORS.glob("bad/*.gs[bt]"))
NOT_A_READERS = {  # notes; levels recomputed; content id; ledger; descriptors of parts, totals
    "GSB-0412", "GSB-0414", "GSB-0503", "GSB-0504", "GSB-0505", "GSB-0506", "GSB-0507", "GSB-0508",
    "GSB-0509", "GSB-0604", "GSB-0601", "GSB-0602", "GSB-0603", "GST-0118", "GST-0119", "GST-0210",
    "GST-0213",
}  # fmt: skip
MUTANTS = 500


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


def answers_to(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """What the reader says of files."""
    ran = subprocess.run(
        [node(), READER / "conformance.mjs"],
        input="".join(f"{path}\n" for path in paths),
        capture_output=True,
        text=True,
        check=True,
    )
    return [json.loads(line) for line in ran.stdout.splitlines()]


@pytest.fixture(scope="module")
def answers(paged: dict[str, Path]) -> dict[Path, dict[str, Any]]:
    """What the reader says of every vector, and of the two larger files."""
    paths = [*GOOD, *BAD, *paged.values()]
    return dict(zip(paths, answers_to(paths), strict=True))


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


class Digests(dict[str, Any]):
    """BLAKE2b of everything that was added under a name."""

    def add(self, name: str, data: bytes) -> None:
        self.setdefault(name, blake2b(digest_size=16)).update(data)

    def hex(self) -> dict[str, str]:
        return {name: digest.hexdigest() for name, digest in self.items()}


def levels_of(path: Path) -> list[dict[str, Any]]:
    """What gstream reads: counts and digests of every level, or of all chunks of a stream."""
    if path.suffix == ".gst":
        return chunks_of(path)
    levels = []
    with open_block_file(path) as file:
        known = [name for name, spec in file.specs.items() if spec.id in (*COLUMN_IDS, *PIECE_IDS)]
        for level in range(file.levels):
            views, digests = list(file.blocks(level)), Digests()
            for view in views:
                digests.add("key", view.key.to_bytes(8, "little"))
                for name in known:
                    digests.add(name, view.column(name).tobytes())
            counts = {"blocks": len(views), "voxels": sum(view.count for view in views)}
            unknown = dict.fromkeys(file.specs.keys() - known)
            levels.append({"level": level, **counts, "columns": digests.hex() | unknown})
    return [level for level in levels if level["blocks"]]


def chunks_of(path: Path) -> list[dict[str, Any]]:
    reader, digests, triangles, vertices = StreamReader(path), Digests(), 0, 0
    unknown = {}
    for number in range(len(reader.chunks)):
        chunk = reader.chunk(number)
        precise = chunk.positions.dtype.itemsize == 8
        for id_, values in (
            (0, chunk.triangles),
            (2 if precise else 1, chunk.positions),
            (3, chunk.normals),
            (4, chunk.colours),
        ):
            if values is not None:
                digests.add(str(id_), values.tobytes())
        unknown |= {str(p.attribute): None for p in reader.head(number).parts if p.attribute > 4}
        triangles += chunk.triangle_count
        vertices += len(chunk.positions)
    if not len(reader.chunks):
        return []
    counts = {"chunks": len(reader.chunks), "triangles": triangles, "vertices": vertices}
    return [{"level": 0, **counts, "columns": digests.hex() | unknown}]


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.stem)
def test_a_good_vector_has_the_content_that_gstream_reads(path, answers) -> None:
    assert answers[path] == {"valid": True, "codes": [], "content": {"levels": levels_of(path)}}


@pytest.mark.parametrize("depth", ["1", "2"])
def test_larger_files_have_the_content_that_gstream_reads(depth, paged, answers) -> None:
    assert answers[paged[depth]]["content"]["levels"] == levels_of(paged[depth])


def broken_rules(path: Path) -> set[str]:
    """What `gstream check` finds broken, notes aside."""
    try:
        return {finding.rule for finding in check_file(path).findings if finding.severity == ERROR}
    except CorruptFileError as error:
        return {error.rule}
    except UnsupportedError:
        return {"unsupported"}


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_a_bad_vector_is_refused_by_a_rule_that_check_finds_broken(path, answers) -> None:
    answer = answers[path]
    if path.stem[:8] in NOT_A_READERS:
        assert answer["valid"]
    else:
        assert not answer["valid"]
        assert path.stem == "GST-0001" or set(answer["codes"]) <= broken_rules(path)


@pytest.fixture(scope="module")
def mutants(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, dict[str, Any]]:
    """What the reader says of damaged files, most of them with their checksums made right."""
    folder = tmp_path_factory.mktemp("mutants")
    paths = []
    for number in range(MUTANTS):
        data = mutant(number).data
        paths.append(folder / f"{number}{'.gst' if data[1:4] == b'GST' else '.gsb'}")
        paths[-1].write_bytes(data)
    return dict(zip(paths, answers_to(paths), strict=True))


def test_of_mutants_the_reader_refuses_those_that_check_finds_broken_and_no_others(mutants) -> None:
    left_to_check = NOT_A_READERS | {"GST-0209"}  # of totals the reader looks at the JSON only
    for path, answer in mutants.items():
        broken = broken_rules(path)
        assert broken <= left_to_check if answer["valid"] else broken, (path, answer)


def test_what_the_reader_accepts_of_mutants_the_reference_decoder_reads_alike(mutants) -> None:
    decoder = run_path(str(ROOT / "spec" / "reference_decoder.py"))
    accepted = {path: answer for path, answer in mutants.items() if answer["valid"]}
    assert len(accepted) > MUTANTS // 10
    for path, answer in accepted.items():
        found = decoder["summary"](path.read_bytes())
        printed = json.loads(json.dumps(found, default=blake2b.hexdigest))
        assert answer["content"] == printed, path
