"""`check` on block files: sound ones, a damaged one per rule, every bit flip and truncation."""

import subprocess
import sys
import tracemalloc
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from damaged_block_files import DAMAGE, Patch, patch, smallest_file, tiny, tiny_file
from small_block_files import Paging, file_bytes, random_scene

from gstream.blockcheck import iter_findings
from gstream.check import KEPT, RULES, check_file
from gstream.errors import CorruptFileError, GstreamError, UnsupportedError, UsageError
from gstream.formats.framing import CODEC_CONSTANT
from gstream.formats.pages import Directory
from gstream.read import open_block_file


def rules_of(data: bytes) -> set[str]:
    return {finding.rule for finding in iter_findings(data)}


def test_sound_files_have_no_findings():
    for scene in (
        tiny(),
        random_scene(12, 3, 60, 1),
        random_scene(40, 3, 900, 2, weighting="count"),
    ):
        assert list(iter_findings(file_bytes(scene))) == []


def test_a_file_of_many_pages_and_table_pages_has_no_findings():
    scene = random_scene(64, 3, 200, 3)
    for paging in (Paging(8), Paging(8, 4, 5), Paging(64, 1, 1)):
        assert list(iter_findings(file_bytes(scene, paging=paging))) == []


def test_a_scene_without_voxels_and_one_without_levels_of_detail_are_sound():
    nothing = replace(tiny(), blocks={})
    assert list(iter_findings(file_bytes(nothing))) == []
    assert list(iter_findings(file_bytes(random_scene(lod=False)))) == []


def test_an_unknown_ancillary_section_is_sound():
    assert list(iter_findings(tiny_file(extra=[(b"note", b"x" * 9), (b"more", b"")]))) == []


@pytest.mark.parametrize("name", sorted(DAMAGE))
def test_a_damaged_file_is_found_by_the_rule_it_is_named_after(name):
    assert name[:8] in rules_of(DAMAGE[name]())


def test_every_rule_has_a_damaged_file():
    assert {rule.id for rule in RULES} == {name[:8] for name in DAMAGE}


def test_findings_have_the_severity_of_their_rule():
    severity = {rule.id: rule.severity for rule in RULES}
    for make in DAMAGE.values():
        for finding in iter_findings(make()):
            assert finding.severity == severity[finding.rule]


@pytest.mark.parametrize(("at", "value"), [(12, b"\2"), (16, b"\1")])
def test_a_newer_version_or_unknown_incompatible_feature_is_unsupported(at, value):
    with pytest.raises(UnsupportedError):
        list(iter_findings(patch().at(at, value).sealed()))


def test_an_unknown_critical_section_is_unsupported():
    made = Patch(tiny_file(extra=[(b"note", b"hello")]))
    with pytest.raises(UnsupportedError):
        list(iter_findings(made.at(256 + 4 * 32 + 4, b"\1").sealed()))


@pytest.mark.parametrize("at", [20, 24])
def test_unknown_read_only_and_ignorable_features_are_read(at):
    assert list(iter_findings(patch().at(at, b"\1").sealed())) == []


def caught(data: bytes, quick: bool = False) -> bool:
    """Whether check finds fault; any error but a GstreamError fails the test."""
    try:
        return bool(list(iter_findings(data, quick)))
    except GstreamError:
        return True


def test_every_single_bit_flip_is_found():
    data = smallest_file()
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        assert caught(bytes(damaged)), f"bit {bit}"


def test_every_truncation_is_found():
    data = smallest_file()
    for size in range(len(data)):
        assert caught(data[:size], quick=True), f"{size} bytes"
    assert caught(data + b"\0", quick=True)


def test_random_bytes_with_right_crcs_raise_only_gstream_errors():
    rng = np.random.default_rng(11)
    made = patch()
    spots = range(12, made.head + len(made.entries.tobytes()))
    for _ in range(200):
        made = patch()
        for spot in rng.choice(spots, 3):
            made.at(int(spot), bytes([rng.choice([0, 1, 127, 255, int(rng.integers(256))])]))
        caught(made.sealed())


def hostile() -> bytes:
    """A small file whose first block claims to be full, with constants for columns."""
    made = Patch(file_bytes(random_scene(64, 6, 30))).entry(0, "count", 8**6)
    for spec in made.columns[1:]:
        for field in ("stored", "offset", "crc", "filter"):
            made.entry(0, field, 0, spec.name)
        made.entry(0, "codec", CODEC_CONSTANT, spec.name)
        made.entry(0, "raw", spec.raw_bytes(8**6), spec.name)
    return made.sealed()


def read_all(data: bytes) -> None:
    with suppress(GstreamError), open_block_file(data) as file:
        for level in range(file.levels):
            for view in file.blocks(level):
                for name in file.columns:
                    with suppress(GstreamError):
                        view.column(name)


def test_no_damaged_file_makes_reader_or_check_allocate_beyond_the_bound():
    for data in [hostile(), *(make() for make in DAMAGE.values())]:
        tracemalloc.start()
        caught(data)
        read_all(data)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 65 << 20


def test_a_report_keeps_a_few_findings_of_a_rule_and_counts_all(tmp_path):
    scene = random_scene(32, 3, 300, 3)
    for key, block in scene.blocks.items():
        scene.blocks[key] = replace(block, mask=block.mask * 0)
    path = tmp_path / "bad.gsb"
    path.write_bytes(file_bytes(scene))
    report = check_file(path)
    assert not report.ok
    assert report.counts["GSB-0410"] == len(scene.blocks)
    assert sum(finding.rule == "GSB-0410" for finding in report.findings) == KEPT
    assert report.as_dict()["counts"]["GSB-0410"] == len(scene.blocks)


def test_quick_reads_no_payload(tmp_path):
    path = tmp_path / "bad.gsb"
    path.write_bytes(DAMAGE["GSB-0411"]())
    assert check_file(path, quick=True).ok
    assert not check_file(path).ok


def test_check_holds_a_bounded_number_of_pages(monkeypatch):
    monkeypatch.setattr("gstream.formats.pages.CACHED_PAGES", 3)
    most = []
    page = Directory.page

    def counting(self, number):
        rows = page(self, number)
        most.append(len(self._pages))
        return rows

    monkeypatch.setattr(Directory, "page", counting)
    assert not list(iter_findings(file_bytes(random_scene(64, 3, 200, 3), paging=Paging(8))))
    assert max(most) <= 3


def test_neither_kind_of_file_and_no_file_are_errors(tmp_path):
    path = tmp_path / "note.txt"
    path.write_text("hello")
    with pytest.raises(CorruptFileError):
        check_file(path)
    with pytest.raises(UsageError):
        check_file(tmp_path / "missing.gsb")


def test_check_does_not_import_numba():
    code = "import sys, gstream.check; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
