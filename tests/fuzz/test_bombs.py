"""Files made to do harm: each is answered by a rule or a value, in little memory and time."""

import pytest

from fuzz.bombs import BOMBS, FULL, full_block, totals
from fuzz.readers import ALLOCATION, deadline, disagreement, limited_memory, outcome, verdict, warm
from gstream.formats.stream import MAX_TOTALS
from gstream_cli.main import status

COMMANDS = (["info"], ["info", "--json"], ["check"], ["check", "--json"], ["check", "--quick"])


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    warm()


@pytest.fixture(params=BOMBS, ids=lambda bomb: bomb.name)
def bomb(request, tmp_path):
    data = request.param.make()
    path = tmp_path / ("bomb.gst" if data[1:4] == b"GST" else "bomb.gsb")
    path.write_bytes(data)
    return path, request.param.said, len(data)


def test_there_are_at_least_60_bombs():
    assert len({bomb.name for bomb in BOMBS}) >= 60


def test_check_names_the_rule_and_readers_agree_within_the_bound_of_memory(bomb):
    path, said, size = bomb
    with deadline() as begin, limited_memory(max(ALLOCATION, 4 * size)):
        begin()
        assert verdict(path) == said
        begin()
        assert disagreement(path) is None


def test_every_command_answers_in_printable_lines_and_with_an_exit_code(bomb, capsys):
    path, said, _ = bomb
    for command in COMMANDS:
        code = status([*command, str(path)])
        out, err = capsys.readouterr()
        assert code in ((0,) if said == "valid" else (0, 4, 6))
        assert all(line.isprintable() for line in (out + err).split("\n"))
        assert err.count("\n") <= 1


def test_a_block_that_is_all_voxels_is_read_and_checked_within_its_columns_and_a_few_more(tmp_path):
    path = tmp_path / "full.gsb"
    path.write_bytes(full_block())
    columns = FULL * (4 + 1 + 4 + 4 + 4)  # codes, mask, normal, colour, weight
    with limited_memory(columns + ALLOCATION):
        read = outcome(path, fast=False)
        assert read.startswith("read")
        assert read == outcome(path, fast=True)
    with limited_memory(columns + 3 * ALLOCATION):
        assert verdict(path) == "GSB-0509"  # the id is that of one voxel


@pytest.mark.parametrize("unit", [b"[" * 60 + b"]" * 60, b'{"":' * 60 + b"0" + b"}" * 60, b"{}"])
def test_totals_that_are_all_tiny_values_are_read_in_256_mib_and_four_times_the_file(
    tmp_path, unit
):
    count = (MAX_TOTALS - 20) // (len(unit) + 1)
    path = tmp_path / "tiny.gst"
    path.write_bytes(totals(b'{"sources":[' + b",".join([unit] * count) + b"]}")())
    with limited_memory((256 << 20) + 4 * path.stat().st_size):
        assert verdict(path) == "GST-0209"
