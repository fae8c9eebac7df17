"""Block files behind URLs: ranges alone, how many, what is noticed and how errors read."""

import json
import socket
import sys
from dataclasses import replace

import numpy as np
import pytest
from range_server import BREAKS_OFF, HANGS_UP, IS_SILENT, serving
from small_block_files import Paging, file_bytes, random_scene

import gstream
from gstream import remote
from gstream.errors import StoppedError, UsageError
from gstream.read import open_block_file
from gstream_cli import main

pytest.importorskip("aiohttp", reason="the extra [remote] is not installed")
fsspec = pytest.importorskip("fsspec", reason="the extra [remote] is not installed")

SCENE = random_scene(128, 3, 1500, seed=5)  # sparse: first siblings are missing
for block in SCENE.blocks.values():
    block.colour[:] = 77  # a constant: a column without bytes
LARGE = file_bytes(SCENE, paging=Paging(512))  # 4 pages; more than the first request opens it
SMALL = file_bytes(random_scene(seed=9))


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    monkeypatch.setattr(remote, "RETRY_SECONDS", (0.0, 0.0))


def some_blocks():
    """(level, place) of every 23rd block of each level, and of the first and last of each page."""
    with open_block_file(LARGE) as file:
        for level in range(file.levels):
            views = list(file.blocks(level))
            ends = set()
            for number in file.directory.pages_of(level):
                ends |= {int(key) for key in file.directory.page(number)["key"][[0, -1]]}
            yield from ((level, v.place) for v in views[::23])
            yield from ((level, v.place) for v in views if v.key in ends)


def test_the_first_picture_takes_two_requests_and_of_a_small_file_one():
    for data, requests in ((file_bytes(SCENE), 2), (SMALL, 1)):
        with serving(data) as site, gstream.open(site.url) as file:
            (coarsest,) = file.blocks(file.levels - 1)
            assert len(coarsest.words()) == len(coarsest.normals()) == coarsest.count > 0
            assert len(site.requests) == requests


def test_all_columns_of_any_block_take_three_requests_at_most():
    counts = {}
    with serving(LARGE) as site, open_block_file(LARGE) as near:
        for level, place in some_blocks():
            site.requests.clear()
            with gstream.open(site.url) as file:
                block, same = file.block(level, place), near.block(level, place)
                for name in file.columns:
                    np.testing.assert_array_equal(block.column(name), same.column(name))
            counts.setdefault(level, set()).add(len(site.requests))
    assert set(counts) == set(range(len(counts)))
    assert counts[0] == {3}
    assert max(map(max, counts.values())) == 3


def test_siblings_cost_one_request_and_all_requests_are_ranges():
    with serving(LARGE) as site, gstream.open(site.url) as file:
        blocks = [(view.key >> 3, view.words()) for view in file.blocks(0)]
        groups = len({parent for parent, _ in blocks})
        pages = len(file.directory.pages_of(0))
        assert len(site.requests) <= 2 + groups + pages
        assert {method for method, _ in site.requests} == {"GET"}
        assert all(asked.startswith("bytes=") for _, asked in site.requests)
        assert site.sent < len(LARGE) + 65_536


def test_a_whole_level_costs_a_request_per_mebibyte_and_page():
    with serving(LARGE) as site, gstream.open(site.url) as file:
        pages = len(file.directory.pages_of(0))
        for view in file.blocks(0):
            view.words()
        assert len(site.requests) <= 2 + 2 * pages + len(LARGE) // (1 << 20)
        assert site.sent < len(LARGE) + 65_536


def test_one_block_of_a_large_file_leaves_most_of_it_where_it_is():
    with serving(LARGE) as site, gstream.open(site.url) as file:
        file.block(0, some_place(0)).words()
        assert site.sent < len(LARGE) / 2  # of it 64 KiB for the head, and a page of 512 entries


def some_place(level):
    return next(place for at, place in some_blocks() if at == level)


@pytest.mark.parametrize("tag", ['"second"', None], ids=["entity tag", "no entity tag"])
def test_a_changed_file_behind_the_url_is_noticed(tag):
    with serving(LARGE, tag=tag and '"first"') as site, gstream.open(site.url) as file:
        list(file.blocks(file.levels - 1))
        site.data, site.tag = file_bytes(replace(SCENE, names=SCENE.names[:4])), tag
        with pytest.raises(StoppedError, match=r"scene.gsb: is no longer the file that was opened"):
            for view in file.blocks(0):
                view.words()


def test_another_entity_tag_is_another_file_whatever_its_bytes():
    with serving(LARGE) as site, gstream.open(site.url) as file:
        site.tag = '"second"'
        with pytest.raises(StoppedError, match="is no longer the file that was opened"):
            file.block(0, some_place(0)).words()


def test_a_changed_file_of_equal_length_without_a_tag_is_noticed_by_its_content_id():
    other = file_bytes(random_scene(128, 3, 1500, seed=6), paging=Paging(512))
    with serving(LARGE, tag=None) as site, gstream.open(site.url) as file:
        list(file.blocks(file.levels - 1))
        site.data = other[: len(LARGE)].ljust(len(LARGE), b"\0")
        with pytest.raises(StoppedError, match="is no longer the file that was opened"):
            for view in file.blocks(0):
                view.words()


def test_a_server_without_ranges_is_refused_and_the_file_not_downloaded():
    with (
        serving(bytes(32 << 20), ranges=False) as site,
        pytest.raises(UsageError, match="the server does not send ranges; download the file"),
    ):
        gstream.open(site.url)
    assert (len(site.requests), site.sent) == (1, 0)


def test_a_range_that_was_not_asked_for_is_refused():
    with serving(SMALL, failures=[206]) as site, pytest.raises(UsageError, match="another range"):
        gstream.open(site.url)


def test_a_missing_file_is_a_usage_error_after_one_request():
    with serving(SMALL, failures=[404]) as site, pytest.raises(UsageError, match="404 Not Found"):
        gstream.open(site.url)
    assert len(site.requests) == 1


@pytest.mark.parametrize("status", [HANGS_UP, IS_SILENT, BREAKS_OFF, 429, 500, 503])
def test_a_passing_failure_is_tried_three_times(monkeypatch, status):
    monkeypatch.setattr(remote, "SILENCE_SECONDS", 0.3)
    with serving(SMALL, failures=[status] * 2) as site, gstream.open(site.url) as file:
        assert file.levels > 1
        assert len(site.requests) == 3


def test_a_failure_that_stays_is_a_usage_error_at_first_and_later_one_to_run_again():
    with serving(LARGE, failures=[503] * 3) as site:
        with pytest.raises(UsageError, match="cannot be read: 503 Service Unavailable; check"):
            gstream.open(site.url)
        with gstream.open(site.url) as file:
            site.failures += [503] * 3
            with pytest.raises(StoppedError, match=r"broke off: 503 .*; run the same command"):
                file.block(0, some_place(0)).words()


@pytest.mark.parametrize(
    ("status", "said"),
    [
        (HANGS_UP, "Server disconnected"),
        (IS_SILENT, "no answer in time"),
        (BREAKS_OFF, "not completed"),
    ],
    ids=["hangs up", "is silent", "breaks off"],
)
def test_a_server_that_stops_answering_is_one_line(monkeypatch, status, said):
    monkeypatch.setattr(remote, "SILENCE_SECONDS", 0.1)
    with serving(LARGE) as site, gstream.open(site.url) as file:
        site.failures += [status] * 6  # the session tries twice on a connection that was used
        with pytest.raises(StoppedError, match=f"reading broke off: .*{said}") as caught:
            file.block(0, some_place(0)).words()
    assert "\n" not in str(caught.value)


def test_a_port_where_nobody_listens_is_a_usage_error_in_one_line():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}/scene.gsb"
    with pytest.raises(UsageError, match=r"scene.gsb: cannot be read: .*; check") as caught:
        gstream.open(url)
    assert "\n" not in str(caught.value)


def test_a_file_of_a_store_reads_as_a_local_one():
    with fsspec.open("memory://bucket/scene.gsb", "wb") as out:
        out.write(LARGE)
    with gstream.open("memory://bucket/scene.gsb") as far, open_block_file(LARGE) as near:
        box = (10, 10, 10), (30, 30, 30)
        found, wanted = far.region(*box, 0, ["colour"]), near.region(*box, 0, ["colour"])
    np.testing.assert_array_equal(found.positions, wanted.positions)
    np.testing.assert_array_equal(found.columns["colour"], wanted.columns["colour"])


def test_a_store_s_missing_file_and_an_unknown_scheme_are_usage_errors():
    with pytest.raises(UsageError, match=r"no.gsb: cannot be read: not found: .*credentials"):
        gstream.open("memory://no.gsb")
    with pytest.raises(UsageError, match=r"nothing://x: cannot be read: Protocol not known"):
        gstream.open("nothing://x")


def test_without_fsspec_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(UsageError, match=r"pip install 'gstream\[remote\]'"):
        gstream.open("s3://bucket/scene.gsb")


def test_info_check_and_preview_take_a_url(capsys, tmp_path):
    with serving(SMALL) as site:
        assert main.status(["info", site.url, "--json"]) == 0
        held = json.loads(capsys.readouterr().out)
        assert (held["bytes"], held["path"], len(site.requests)) == (len(SMALL), site.url, 1)
        assert main.status(["check", "--quick", site.url]) == 0
        assert "block file, structure and indexes: valid" in capsys.readouterr().out
        assert main.status(["check", "-q", site.url]) == 0
        picture = tmp_path / "scene.png"
        assert main.status(["preview", site.url, "-o", str(picture), "--size", "32x32"]) == 0
        assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_a_url_that_cannot_be_read_is_one_line_and_exits_with_2(capsys):
    with serving(SMALL, failures=[403] * 2) as site:
        for command in ("info", "check"):
            assert main.status([command, site.url]) == 2
            err = capsys.readouterr().err
            assert err.startswith(f"gstream: {site.url}: cannot be read: 403 Forbidden; ")
            assert err.count("\n") == 1
