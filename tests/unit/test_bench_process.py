"""What a benchmark says of a program that it ran."""

import sys
from pathlib import Path

import pytest

from tests.bench.peers import Peers
from tests.bench.process import CommandFailed, expect, run

HOLD = "import time; held = bytearray(b'x') * (64 << 20); time.sleep(1); print('done')"


def peers(*commands: str, seconds: float = 60) -> Peers:
    return Peers((), (), commands, seconds, 1 << 30, 1)


def test_the_peak_is_of_the_programs_whole_tree() -> None:
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {HOLD!r}])"
    cost = run([sys.executable, "-c", child])
    assert cost.out == "done\n"
    assert 64 << 20 <= cost.peak_bytes < 128 << 20


def test_a_program_is_killed_when_its_time_is_over() -> None:
    assert run([sys.executable, "-c", "import time; time.sleep(60)"], 0.2).returncode == -9


def test_a_gstream_command_that_fails_says_what_and_why(tmp_path: Path) -> None:
    with pytest.raises(CommandFailed, match=r"gstream info \S+/none.gsb: exit code 2: "):
        expect("info", tmp_path / "none.gsb")


def test_a_template_is_given_the_mesh_the_resolution_and_an_output(tmp_path: Path) -> None:
    (tmp_path / "a b.ply").write_bytes(b"12345")
    (found,) = peers("cp {mesh} {output}").measure(tmp_path / "a b.ply", 64, tmp_path)
    assert (found["what"], found["output_bytes"]) == ("cp", 5)
    assert [path.name for path in tmp_path.iterdir()] == ["a b.ply"]
    (found,) = peers("sh -c 'echo {resolution} >&2; exit 3'").measure(tmp_path, 64, tmp_path)
    assert found == {"what": "sh", "error": "exit code 3: 64"}


def test_a_peer_that_is_not_there_is_an_error_of_one_line(tmp_path: Path) -> None:
    (found,) = peers("no-such-program {mesh}").measure(tmp_path, 64, tmp_path)
    assert "No such file or directory: 'no-such-program'" in found["error"]


def test_a_peer_that_was_killed_is_not_tried_again(tmp_path: Path) -> None:
    slow = peers("sleep 60", seconds=0.2)
    (found,) = slow.measure(tmp_path, 64, tmp_path)
    assert found == {"what": "sleep", "error": "killed after 0 s"}
    assert slow.measure(tmp_path, 128, tmp_path) == []
