"""One context of OpenGL and the models of all tests that draw."""

import pytest
from display import missing

from gl import scenes
from gstream_tools.view_gl import programs


@pytest.fixture(scope="session")
def context():
    """OpenGL without a window; where there is none a test is skipped, but fails in CI."""
    try:
        from gstream_tools.view_gl import offscreen

        return offscreen.context()
    except (ImportError, RuntimeError) as error:
        missing(str(error))


@pytest.fixture(scope="session")
def torus(tmp_path_factory):
    """A closed mesh, 5 levels of blocks of 8^3."""
    folder = tmp_path_factory.mktemp("torus")
    return scenes.build(folder, "torus", scenes.torus(), resolution=128, block=8)


@pytest.fixture(scope="session")
def fine_torus(tmp_path_factory):
    """The closed mesh at twice the resolution."""
    folder = tmp_path_factory.mktemp("fine")
    return scenes.build(folder, "torus", scenes.torus(), resolution=256, block=16)


@pytest.fixture(scope="session")
def slab(tmp_path_factory):
    """A box with every voxel that it touches."""
    folder = tmp_path_factory.mktemp("slab")
    settings = {"resolution": 128, "block": 8, "sep": "conservative"}
    return scenes.build(folder, "slab", scenes.slab(), **settings)


@pytest.fixture(scope="session")
def strip(tmp_path_factory):
    """A sheet with one side, both of whose faces were asked for."""
    folder = tmp_path_factory.mktemp("strip")
    return scenes.build(folder, "strip", scenes.strip(), resolution=128, block=8, faces="both")


@pytest.fixture
def shader_fault(monkeypatch):
    """Replaces a piece of shader source that must be there, from then on."""

    def plant(lost, instead):
        source = programs._source

        def changed(parts, defines):
            return source(parts, defines).replace(lost, instead)

        everything = source(("common", "voxel.vert", "faces.frag"), {})
        assert everything.count(lost) == 1, "the fault has nothing to replace"
        monkeypatch.setattr(programs, "_source", changed)

    return plant
