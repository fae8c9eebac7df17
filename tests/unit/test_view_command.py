"""`gstream view`: what it hands over to the viewer, and what it says where that cannot run."""

import sys

import pytest

from gstream_cli import main, viewer


@pytest.mark.parametrize(
    "arguments",
    [
        ["a.gsb"],
        ["a.gsb", "--size", "10x10", "-q", "--json", "--camera=-1,2,3:0,0,0"],
        ["--sync", "--scene", "s.toml", "https://example.org/a.gsb", "--explain"],
        [],
    ],
    ids=" ".join,
)
def test_every_argument_goes_to_the_viewer_in_its_order(monkeypatch, arguments):
    class StartedError(BaseException):
        pass

    def start(program, given):
        raise StartedError(program, given)

    monkeypatch.setattr(viewer.os, "execv", start)
    with pytest.raises(StartedError) as started:
        main.status(["view", *arguments])
    program, given = started.value.args
    assert (program, given[0]) == (sys.executable, sys.executable)
    assert given[1:] == ["-m", "gstream_tools.view_gl", *arguments]


@pytest.mark.parametrize("absent", ["moderngl", "glfw"])
def test_without_the_extra_it_says_how_to_install_it(monkeypatch, capsys, absent):
    monkeypatch.setattr(viewer, "find_spec", lambda name: None if name == absent else object())
    assert main.status(["view", "a.gsb"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("gstream: the viewer needs ")
    assert said.endswith("pip install 'gstream[gl]'\n")
    assert said.count("\n") == 1
