"""tools/reader_py over HTTP: one connection, ranges alone, and what servers do wrong."""

import socket

import numpy as np
import pytest
from range_server import BREAKS_OFF, HANGS_UP, IS_SILENT, serving
from small_block_files import Paging, file_bytes, random_scene

from gstream_tools.reader_py import BlockFile, SourceError, open_source, source

LARGE = file_bytes(random_scene(64, voxels=9000), paging=Paging(128))


def finest(file):
    entries = file.page(file.pages - 1)
    return entries[entries["level"] == 0]


def test_a_file_behind_a_url_reads_as_a_local_one(tmp_path):
    path = tmp_path / "a.gsb"
    path.write_bytes(LARGE)
    with serving(LARGE) as site, BlockFile(open_source(site.url)) as far:
        with BlockFile(open_source(str(path))) as near:
            wanted = near.load(finest(near), ["occupancy", "mask", "normal"])
        for a, b in zip(
            far.load(finest(far), ["occupancy", "mask", "normal"]), wanted, strict=True
        ):
            np.testing.assert_array_equal(a["words"], b["words"])
            np.testing.assert_array_equal(a["normal"], b["normal"])
        assert (far.source.requests, far.source.bytes) == (len(site.requests), site.sent)
        assert {method for method, _ in site.requests} == {"GET"}
        assert all(asked.startswith("bytes=") for _, asked in site.requests)


def test_the_first_picture_takes_two_requests_and_a_far_block_two_more():
    with serving(LARGE) as site, BlockFile(open_source(site.url)) as file:
        file.load_opening()
        assert [asked for _, asked in site.requests] == [
            "bytes=0-65535",
            f"bytes=65536-{file.head.head_bytes + file.opening_bytes - 1}",
        ]
        file.load(finest(file)[-1:], ["occupancy"])
        assert len(site.requests) == 4


@pytest.mark.parametrize("tag", ['"second"', None], ids=["entity tag", "length alone"])
def test_a_file_that_changes_behind_its_url_is_noticed_in_the_next_answer(tag):
    with serving(LARGE, tag=tag and '"first"') as site, BlockFile(open_source(site.url)) as file:
        site.tag = tag
        site.data = LARGE if tag else LARGE + b"\0"
        with pytest.raises(SourceError, match=r"scene.gsb: is no longer the file that was opened"):
            file.load_opening()


def test_a_server_without_ranges_is_an_error_that_says_so_and_the_file_not_downloaded():
    with serving(bytes(64 << 20), ranges=False) as site:
        with pytest.raises(SourceError, match="the server does not send ranges"):
            BlockFile(open_source(site.url))
        assert len(site.requests) == 1
    assert site.sent < 64 << 20


def test_a_server_that_stops_sending_ranges_is_noticed():
    with serving(LARGE) as site, BlockFile(open_source(site.url)) as file:
        site.ranges = False
        with pytest.raises(SourceError, match="the server does not send ranges"):
            file.load_opening()


@pytest.mark.parametrize(
    ("failure", "said"),
    [
        (404, "404 Not Found"),
        (503, "503 Service Unavailable"),
        (206, "another range than was asked for"),
        (BREAKS_OFF, "4 bytes came of a range|IncompleteRead"),
        (IS_SILENT, "timed out"),
    ],
)
def test_a_server_that_fails_is_an_error_in_one_line_and_may_be_asked_again(
    failure, said, monkeypatch
):
    monkeypatch.setattr(source, "SECONDS", 1 if failure == IS_SILENT else 30)
    with serving(LARGE) as site, BlockFile(open_source(site.url)) as file:
        site.failures.append(failure)
        with pytest.raises(SourceError, match=said) as caught:
            file.load_opening()
        assert "\n" not in str(caught.value)
        file.load_opening()


def test_a_connection_that_the_server_closed_meanwhile_is_opened_again():
    with serving(LARGE) as site, BlockFile(open_source(site.url)) as file:
        site.failures.append(HANGS_UP)
        file.load_opening()
        assert len(site.requests) == file.source.requests == 3


def test_a_server_that_hangs_up_on_a_new_connection_is_an_error():
    with serving(LARGE, failures=[HANGS_UP]) as site, pytest.raises(SourceError, match="read: "):
        BlockFile(open_source(site.url))


def test_a_redirection_is_followed_and_the_next_request_goes_straight_there():
    with serving(LARGE) as there, serving(b"", failures=[302], location=there.url) as here:
        with BlockFile(open_source(here.url)) as file:
            file.load_opening()
        assert (len(here.requests), len(there.requests)) == (1, 2)


def test_redirections_end_and_lead_to_no_other_scheme():
    with serving(LARGE, failures=[307] * 9) as site:
        with pytest.raises(SourceError, match="redirected too often"):
            BlockFile(open_source(site.url))
        site.location = "file:///etc/passwd"
        with pytest.raises(SourceError, match="'file:///etc/passwd' is no URL to read from"):
            BlockFile(open_source(site.url))


def test_an_empty_file_behind_a_url_is_no_block_file():
    with serving(b"") as site, pytest.raises(Exception, match=r"no block file \[GSB-0101\]"):
        BlockFile(open_source(site.url))


def test_a_url_with_spaces_and_letters_of_other_alphabets_is_asked_for_quoted():
    with serving(LARGE) as site:
        url = site.url.replace("scene", "a scène").replace("gsb", "gsb?x=ä b")
        BlockFile(open_source(url)).close()
        assert len(site.requests) == 1


def test_a_port_where_nobody_listens_is_an_error_in_one_line():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}/scene.gsb"
    with pytest.raises(SourceError, match=r"scene.gsb: cannot be read: ") as caught:
        BlockFile(open_source(url))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("url", ["http://[", "http://a:b/", "http:///x\ny"])
def test_what_is_no_url_is_an_os_error(url):
    with pytest.raises(OSError, match=r"no URL|cannot be read"):
        BlockFile(open_source(url))
