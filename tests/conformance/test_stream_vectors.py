"""The frozen vectors of the geometry stream, and what readers do with files that are not whole."""

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conformance.stream_bytes import (
    BAD,
    FAN,
    FAN_FILE,
    FAN_TRIANGLES,
    NEWER,
    SMALLEST,
    SOUP,
    UNKNOWN_PART,
    StreamBytes,
)
from conformance.stream_bytes import GOOD as PLAIN
from conformance.stream_freedoms import FREEDOMS
from hypothesis import given
from hypothesis import strategies as st

from gstream.check import check_file
from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.findings import ERROR
from gstream.formats.stream import StreamReader
from gstream.formats.stream_check import iter_findings

GOOD = PLAIN | FREEDOMS
ROOT = Path(__file__).parents[2]
VECTORS = ROOT / "spec" / "vectors"
RULES = ROOT / "spec" / "rules.md"
SOURCES = (ROOT / "gstream" / "formats").glob("stream*.py")


def rules_of(path: Path, quick: bool = False) -> list[str]:
    return [finding.rule for finding in iter_findings(path, quick)]


def rules_in(text: str) -> set[str]:
    return set(re.findall(r"GST-\d{4}", text))


@pytest.mark.parametrize("name", GOOD)
def test_a_good_vector_is_as_the_spec_makes_it(name):
    assert (VECTORS / "good" / f"{name}.gst").read_bytes() == GOOD[name].write()


@pytest.mark.parametrize("name", GOOD)
def test_a_good_vector_breaks_no_rule(name):
    findings = iter_findings(VECTORS / "good" / f"{name}.gst")
    assert [finding for finding in findings if finding.severity == ERROR] == []


@pytest.mark.parametrize("name", BAD)
def test_a_bad_vector_is_as_the_spec_makes_it(name):
    assert (VECTORS / "bad" / f"{name}.gst").read_bytes() == BAD[name]


@pytest.mark.parametrize("name", BAD)
def test_a_bad_vector_breaks_the_rule_it_is_named_after_first(name):
    assert rules_of(VECTORS / "bad" / f"{name}.gst")[0] == name[:8]


def test_every_rule_of_the_spec_is_in_the_source_and_has_a_bad_vector():
    table = rules_in(RULES.read_text())
    assert table == rules_in("".join(path.read_text() for path in SOURCES))
    assert table == {path.stem[:8] for path in (VECTORS / "bad").glob("GST-*")}


@pytest.mark.parametrize("what", NEWER)
def test_what_this_version_cannot_read_is_unsupported_and_not_corrupt(what, tmp_path):
    path = tmp_path / "newer.gst"
    path.write_bytes(NEWER[what].write())
    with pytest.raises(UnsupportedError, match="use a newer gstream"):
        StreamReader(path).chunk(0)


def test_the_indexed_vector_unpacks_to_its_triangles():
    chunk = StreamReader(VECTORS / "good" / "stream-indexed.gst").chunk(0)
    np.testing.assert_array_equal(chunk.positions, np.array(FAN, np.float32))
    np.testing.assert_array_equal(chunk.triangles, FAN_TRIANGLES)
    np.testing.assert_array_equal(chunk.normals, [[0, 0, 1]] * 5)
    np.testing.assert_array_equal(chunk.colours, np.arange(16).reshape(4, 4))
    assert (chunk.colour_domain, chunk.non_finite, chunk.degenerate) == (2, 2, 1)


def test_the_vector_of_edge_codes_unpacks_to_its_triangles():
    chunk = StreamReader(VECTORS / "good" / "stream-edges.gst").chunk(0)
    np.testing.assert_array_equal(chunk.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])


def test_good_vectors_have_the_most_of_what_streams_are_made_of():
    full = StreamReader(VECTORS / "good" / "stream-full-chunk.gst").head(0)
    assert (full.triangles, full.vertices) == (65_536, 65_536)
    reader = StreamReader(VECTORS / "good" / "stream-most-parts.gst")
    assert (len(reader.attributes), len(reader.head(0).parts)) == (32, 32)


def test_an_unknown_attribute_is_skipped_by_its_size():
    chunk = StreamReader(VECTORS / "good" / "stream-unknown-attribute.gst").chunk(0)
    assert len(chunk.positions) == 3


@pytest.mark.parametrize(
    ("name", "read"),
    [("", {0, 1, 4}), ("-filter", {0, 4}), ("-domain", {0, 1}), ("-index", {1, 4})],
)
def test_an_unknown_domain_codec_or_filter_concerns_its_own_attribute_only(name, read):
    path = VECTORS / "bad" / f"GST-0119{name}.gst"
    assert StreamReader(path).parts(0).keys() == read
    assert set(rules_of(path)) == {"GST-0119"}
    assert check_file(path).ok


def test_what_is_unknown_is_refused_when_it_is_asked_for_and_not_before():
    reader = StreamReader(VECTORS / "bad" / "GST-0119.gst")
    assert reader.chunk(0, ["colour"]).normals is None
    with pytest.raises(UnsupportedError, match="codec 3 of attribute normal"):
        reader.chunk(0, ["normal"])


def test_the_checksum_of_an_unknown_part_is_checked_too(tmp_path):
    path = tmp_path / "odd.gst"
    odd = replace(SOUP, parts=(replace(UNKNOWN_PART, crc=0), *SOUP.parts))
    path.write_bytes(replace(GOOD["stream-unknown-attribute"], chunks=(odd,)).write())
    assert rules_of(path) == ["GST-0111"]


@pytest.mark.parametrize("file", [SMALLEST, FAN_FILE], ids=["soup", "indexed"])
def test_every_flipped_bit_is_found(file, tmp_path):
    whole, path = file.write(), tmp_path / "flipped.gst"
    for bit in range(8 * len(whole)):
        data = bytearray(whole)
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        assert _is_refused(path), f"bit {bit % 8} of byte {bit // 8} may flip unseen"


def _is_refused(path: Path) -> bool:
    try:
        return bool(rules_of(path))
    except UnsupportedError:
        return True


@pytest.mark.parametrize("file", [SMALLEST, FAN_FILE], ids=["soup", "indexed"])
def test_every_cut_is_found_and_leaves_the_chunks_before_it_readable(file, tmp_path):
    doubled = replace(file, chunks=file.chunks * 2)
    whole, path = doubled.write(), tmp_path / "cut.gst"
    start, length = len(doubled.header()), len(doubled.chunks[0].write())
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(CorruptFileError):
            StreamReader(path)
        if size >= start:
            reader = StreamReader.recover(path)
            assert len(reader.chunks) == min(2, (size - start) // length)
            if len(reader.chunks):
                assert len(reader.chunk(0).positions) == file.chunks[0].vertices


def test_bytes_after_the_tail_are_found(tmp_path):
    path = tmp_path / "long.gst"
    path.write_bytes(SMALLEST.write() + b"\0")
    assert rules_of(path) == ["GST-0201"]


WORDS = st.sampled_from([0, 1, 2, 3, 4, 5, 36, 255, 65_535, 65_536, 2**31, 2**32 - 1])
SHORT = st.sampled_from([0, 1, 2, 3, 4, 5, 33, 255, 65_535])
BYTE = st.integers(0, 8)


@st.composite
def hostile_streams(draw) -> StreamBytes:
    """Files whose CRCs are right and whose numbers are not."""
    chunk = draw(st.sampled_from([SOUP, FAN_FILE.chunks[0]]))
    parts = tuple(
        replace(
            part,
            attribute=draw(st.sampled_from([part.attribute, 0, 1, 2, 3, 4, 900])),
            domain=draw(st.sampled_from([part.domain, 0, 1, 2, 3, 9])),
            filter=draw(BYTE),
            codec=draw(st.sampled_from([0, 1, 2, 3])),
            raw=draw(st.one_of(st.just(part.raw), WORDS)),
            stored=draw(st.one_of(st.just(part.stored), st.binary(max_size=64))),
        )
        for part in chunk.parts
    )
    keys = ("triangles", "vertices", "source", "non_finite", "degenerate")
    edits = {key: draw(WORDS) for key in draw(st.sets(st.sampled_from(keys), max_size=2))}
    if draw(st.booleans()):
        edits["index_bytes"] = draw(SHORT)
    chunks = (replace(chunk, parts=parts, **edits),)
    return replace(FAN_FILE, chunks=chunks, totals=draw(st.sampled_from([None, b"{}", b"[" * 999])))


@given(hostile_streams())
def test_wrong_numbers_under_right_checksums_never_raise_another_error(tmp_path_factory, stream):
    path = tmp_path_factory.mktemp("hostile") / "a.gst"
    path.write_bytes(stream.write())
    with suppress(UnsupportedError):
        assert all("\n" not in str(finding) for finding in iter_findings(path))
