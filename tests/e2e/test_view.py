"""The viewer as a user runs it without a window: pictures, films, what is read, what is refused."""

import json
import subprocess
import sys
from math import pi, sqrt, tan

import numpy as np
import pytest
from display import need_opengl
from e2e.meshes import sphere, write_ply
from e2e.program import ENVIRONMENT, gstream, succeed
from PIL import Image
from range_server import serving

from gstream_tools.reader_py import BlockFile, open_source
from gstream_tools.view_gl.__main__ import main

VOXEL = 1.4  # pixels, of the spheres from FRONT; their voxels' corners lie less than that outside
BACKGROUND = (26, 26, 26)  # 0.1 of 255, the scene's default
SMALL = ("--size", "200x200")
FRONT = ("--camera=0,-4,0:0,0,0:45",)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A sphere of radius 1, of one colour and of none."""
    made = tmp_path_factory.mktemp("view")
    write_ply(made / "sphere.ply", *sphere())
    build = ("--resolution", 96, "--block", 16, "--workers", 0, "--quiet", "-o")
    succeed(made, "build", "sphere.ply", *build, "sphere.gsb")
    points, triangles = sphere()
    lines = [f"{x} {y} {z} 1 0.5 0" for x, y, z in points.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in triangles.tolist()]
    head = f"COFF\n{len(points)} {len(triangles)} 0\n"
    (made / "orange.off").write_text(head + "\n".join(lines) + "\n")
    succeed(made, "build", "orange.off", *build, "orange.gsb")
    return made


@pytest.fixture(scope="module")
def view(folder):
    """Run the viewer in the folder, which must succeed; its stdout."""
    need_opengl()

    def run(*arguments):
        command = [sys.executable, "-m", "gstream_tools.view_gl", *map(str, arguments)]
        done = subprocess.run(
            command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def pixels(path):
    return np.asarray(Image.open(path))


def covered(path):
    """How many pixels are not the background."""
    return int((pixels(path) != BACKGROUND).any(axis=-1).sum())


def test_a_sphere_is_as_large_as_perspective_has_it(folder, view):
    view("sphere.gsb", "--offscreen", "front.png", *SMALL, *FRONT)
    radius = 100 / sqrt(4 * 4 - 1) / tan(pi / 8)  # where a ray from distance 4 touches it
    assert pi * radius**2 < covered(folder / "front.png") < pi * (radius + VOXEL) ** 2
    picture = pixels(folder / "front.png")
    assert all((picture[y, x] == BACKGROUND).all() for y in (0, -1) for x in (0, -1))


def test_a_sphere_is_as_large_as_the_scene_s_parallel_projection_has_it(folder, view):
    scene = '[camera]\nprojection = "orthographic"\nheight = 4\nazimuth = 90\n'
    (folder / "parallel.toml").write_text(scene)
    view("sphere.gsb", "--scene", "parallel.toml", "--offscreen", "parallel.png", *SMALL)
    assert pi * 50**2 < covered(folder / "parallel.png") < pi * (50 + VOXEL) ** 2


def test_the_default_lamp_is_over_the_left_shoulder(folder, view):
    view("sphere.gsb", "--offscreen", "lamp.png", *SMALL, "--camera", "fit:130,-20")
    picture = pixels(folder / "lamp.png").astype(int).sum(axis=-1)
    quarters = {
        (y, x): picture[y : y + 60, x : x + 60].mean() for y in (40, 100) for x in (40, 100)
    }
    assert max(quarters, key=quarters.get) == (40, 40)
    assert min(quarters, key=quarters.get) == (100, 100)


def test_a_picture_is_the_same_twice_byte_for_byte_and_so_is_gstream_view_s(folder, view):
    view("sphere.gsb", "--offscreen", "a.png", *SMALL)
    view("sphere.gsb", "--offscreen", "b.png", *SMALL)
    said = succeed(folder, "view", "sphere.gsb", "--offscreen", "c.png", *SMALL)
    assert said.startswith("c.png: 200x200, ")
    first = (folder / "a.png").read_bytes()
    assert (folder / "b.png").read_bytes() == (folder / "c.png").read_bytes() == first


def test_a_constant_colour_is_shown_though_no_column_is_read(folder, view):
    (folder / "flat.toml").write_text('[shade]\nmodel = "flat"\n')
    plain = ("orange.gsb", "--scene", "flat.toml")
    found = json.loads(view(*plain, "--explain", "--json"))
    assert found["columns"] == ["occupancy", "mask"]
    view(*plain, "--offscreen", "orange.png", *SMALL, *FRONT)
    seen = {tuple(colour) for colour in pixels(folder / "orange.png").reshape(-1, 3).tolist()}
    assert seen == {BACKGROUND, (255, 128, 0)}


def test_the_first_picture_takes_two_requests_and_says_what_it_read(folder, view):
    data = (folder / "sphere.gsb").read_bytes()
    assert len(data) > 1 << 16
    with serving(data) as site:
        said = json.loads(
            view(site.url, "--offscreen", "url.png", "--json", "--pixel-error", 1024, *SMALL)
        )
        assert (said["requests"], said["read_bytes"]) == (len(site.requests), site.sent)
    assert len(site.requests) == 2
    assert said["deepest"] == said["levels"] - 1
    assert said["file_bytes"] == len(data)


def test_options_override_the_scene(folder, view):
    (folder / "scene.toml").write_text("[camera]\nsamples = 2\n[lod]\npixel_error = 3\n")
    how = ("sphere.gsb", "--scene", "scene.toml", "--json", "--force", *SMALL)
    scene = json.loads(view(*how, "--offscreen", "o.png"))
    assert (scene["samples"], scene["pixel_error"]) == (2, 3)
    option = json.loads(view(*how, "--offscreen", "o.png", "--samples", 4, "--pixel-error", 2))
    assert (option["samples"], option["pixel_error"]) == (4, 2)


def test_a_scene_may_name_its_file(folder, view):
    inner = folder / "inner"
    inner.mkdir()
    (inner / "named.toml").write_text('[source]\nfile = "../sphere.gsb"\n')
    assert "visibility" in view("--scene", "inner/named.toml", "--explain")


def test_a_synchronous_film_ends_in_the_picture_of_its_last_camera(folder, view):
    keys = [{"time": t, "azimuth": a, "zoom": z} for t, a, z in ((0, 0, 1), (0.2, 60, 4))]
    (folder / "path.json").write_text(json.dumps({"fps": 20, "keys": keys}))
    (folder / "lamp.toml").write_text("[[light]]\ndirection = [-1, 1, -2]\n")
    lit = ("sphere.gsb", "--scene", "lamp.toml", *SMALL)
    view(*lit, "--path", "path.json", "--frames", "film", "--sync")
    view(*lit, "--offscreen", "last.png", "--camera", "fit:60,18,4")
    assert sorted(path.name for path in (folder / "film").iterdir()) == [
        *(f"frame-{number:05d}.png" for number in range(5)), "frames.jsonl",
    ]  # fmt: skip
    lines = [json.loads(line) for line in (folder / "film/frames.jsonl").read_text().splitlines()]
    assert [line["time"] for line in lines] == pytest.approx([0, 0.05, 0.1, 0.15, 0.2])
    assert all(line["converged"] and line["wanted"] == 0 for line in lines)
    np.testing.assert_array_equal(
        pixels(folder / "film/frame-00004.png"), pixels(folder / "last.png")
    )


def test_a_streaming_film_shows_coarse_levels_first(folder, view):
    keys = [{"time": t, "azimuth": 0} for t in (0, 3)]
    (folder / "still.json").write_text(json.dumps({"fps": 10, "keys": keys}))
    view("sphere.gsb", "--path", "still.json", "--frames", "stream", "--pixel-error", 1, *SMALL)
    lines = [json.loads(line) for line in (folder / "stream/frames.jsonl").read_text().splitlines()]
    assert lines[0]["wanted"] > 0
    depths = [line["deepest"] for line in lines if line["voxels"]]
    assert depths[0] == 3
    assert depths == sorted(depths, reverse=True)
    assert depths[-1] < 3
    assert sum(line["uploaded"] for line in lines[1:]) > 0


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["no.gsb"], 2, "no.gsb: No such file"),
        ([], 2, "no block file is named"),
        (["--bogus"], 2, "unrecognized arguments: --bogus; see --help"),
        (["sphere.gsb", "--size", "0x9"], 2, "argument --size: '0x9' is no size"),
        (["sphere.gsb", "--pixel-error", "nan"], 2, "argument --pixel-error: 'nan' is not"),
        (["sphere.gsb", "--samples", "3"], 2, "argument --samples: invalid choice: 3"),
        (["sphere.gsb", "--path", "x.json"], 2, "--path and --frames go together"),
        (["sphere.gsb", "--path", "x.json", "--frames", "f"], 2, "x.json: No such file"),
        (["sphere.gsb", "--path", "key.toml", "--frames", "f"], 4, "key.toml: is no JSON"),
        (["sphere.gsb", "--offscreen", "sphere.ply"], 2, "sphere.ply: exists"),
        (["sphere.gsb", "--camera", "fit:0,91"], 2, "camera 'fit:0,91' is not understood"),
        (
            ["sphere.gsb", "--camera", "0,0,5:0,0,0"],
            2,
            "camera '0,0,5:0,0,0': is the target",
        ),
        (["sphere.gsb", "--camera", "1,1,1:1,1,nan"], 2, "camera '1,1,1:1,1,nan' is not"),
        (["sphere.ply"], 4, "sphere.ply: byte 0: this is no block file [GSB-0101]"),
        (["cut.gsb"], 4, "cut.gsb: "),
        (["sphere.gsb", "--scene", "no.toml"], 2, "no.toml: No such file"),
        (["sphere.gsb", "--scene", "key.toml"], 4, "key.toml: camera.fog: is no such key"),
        (["sphere.gsb", "--scene", "lens.toml"], 6, "lens.toml: lens: depth of field needs rays"),
        (["sphere.gsb", "--scene", "colours.toml"], 6, "colours.toml: colour: needs the column"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_what_cannot_be_shown_is_said_in_one_line(
    folder, capsys, monkeypatch, arguments, status, said
):
    monkeypatch.chdir(folder)
    (folder / "cut.gsb").write_bytes((folder / "sphere.gsb").read_bytes()[:-1])
    (folder / "key.toml").write_text("[camera]\nfog = 1\n")
    (folder / "lens.toml").write_text("[camera]\naperture = 1\n")
    (folder / "colours.toml").write_text('[source]\ncolours = "required"\n')
    assert main(arguments) == status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"view_gl: {said}")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize("how", ["picture", "film"])
def test_damage_that_only_a_drawn_block_shows_ends_with_4(folder, capsys, how):
    need_opengl()
    data = bytearray((folder / "sphere.gsb").read_bytes())
    with BlockFile(open_source(str(folder / "sphere.gsb"))) as file:
        for entry in np.concatenate([file.page(page) for page in range(file.pages)]):
            if entry["level"] == 0:
                data[int(entry["occupancy"]["offset"])] ^= 1
    (folder / "hurt.gsb").write_bytes(data)
    keys = [{"time": t, "azimuth": 0} for t in (0, 3)]
    (folder / "hurt.json").write_text(json.dumps({"fps": 10, "keys": keys}))
    paths = [str(folder / name) for name in ("hurt.gsb", "hurt.png", "hurt.json", "hurt")]
    film = ["--path", paths[2], "--frames", paths[3]]
    end = film if how == "film" else ["--offscreen", paths[1]]
    assert main([paths[0], "--pixel-error", "0", "-q", *SMALL, *end]) == 4
    said = capsys.readouterr().err
    assert said.startswith(f"view_gl: {paths[0]}: column 'occupancy' of block ")
    assert said.endswith("has another CRC [GSB-0411]\n")
    assert said.count("\n") == 1


def test_a_server_without_ranges_is_refused(folder, capsys):
    with serving((folder / "sphere.gsb").read_bytes(), ranges=False) as site:
        assert main([site.url]) == 2
    assert "the server does not send ranges" in capsys.readouterr().err


def test_without_a_display_a_window_is_refused(folder, capsys, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main([str(folder / "sphere.gsb")]) == 6
    said = capsys.readouterr().err
    assert said.startswith("view_gl: no window: ")
    assert said.endswith("or --offscreen\n")


def test_gstream_view_hands_on_the_viewer_s_errors(folder):
    done = gstream(folder, "view", "sphere.ply", "-q")
    assert (done.returncode, done.stdout) == (4, "")
    assert done.stderr == "view_gl: sphere.ply: byte 0: this is no block file [GSB-0101]\n"
