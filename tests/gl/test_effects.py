"""Only the effects that a scene calls for are read, compiled and run; and they do what they say."""

import numpy as np
import pytest

from gl import scenes
from gstream_tools.reader_py import BlockFile, open_source
from gstream_tools.scene import Facts, RefusedSceneError, Resolution, resolve, scene_of
from gstream_tools.view_gl import draw
from gstream_tools.view_gl.frame import Renderer

SIZE = (96, 72)
FLAT = {"shade": {"model": "flat"}, "light": []}
OWN = {
    "SPRITES",
    "DEPTHS",
    "STRIDE",
    "CUT_HERE",
    "SAMPLES",
}  # which form of a program, not what it shows


def picture(context, model, direction=(1, 0.6, 0.4), zoom=1.0, cut="shader", **tables):
    """A converged picture, and the renderer, which is closed."""
    renderer = scenes.renderer(context, model.path, SIZE, cut=cut, **tables)
    camera = scenes.camera_from(renderer.file, direction, SIZE, zoom)
    renderer.log = []
    try:
        for _ in range(50):
            done = renderer.frame(camera)
            renderer.log += [name for name in renderer.painter.passes if name not in renderer.log]
            if done.converged:
                break
    finally:
        renderer.close()
    return renderer.picture().copy(), renderer


SCENES = {
    "flat": FLAT,
    "lit": {},
    "highlights": {"shade": {"model": "blinn-phong"}},
    "shadow": {"light": [{"direction": [-1, 1, -1], "shadows": True}]},
    "two lights": {"light": [{"direction": [0, 1, -1]}, {"kind": "point", "position": [3, 3, 3]}]},
    "stencil": {"dynamic": {"stencil": [{"centre": [1, 0, 0], "radius": 0.5}]}},
    "shear": {"dynamic": {"deform": "shear", "matrix": [[1, 0.3, 0], [0, 1, 0], [0, 0, 1]]}},
    "wave": {"dynamic": {"deform": "wave", "amplitude": 0.1, "wavelength": 1.5}},
    "samples": {"camera": {"samples": 4}},
    "reconstructed": {"camera": {"samples": 4, "sraa": True}},
    "no occlusion": {"budget": {"occlusion": False}},
}


@pytest.mark.parametrize("name", SCENES)
def test_what_is_read_compiled_and_run_is_what_the_scene_calls_for(
    context, torus, monkeypatch, name
):
    read = set()
    load = BlockFile.load
    monkeypatch.setattr(
        BlockFile,
        "load",
        lambda self, entries, names: read.update(names) or load(self, entries, names),
    )
    _, renderer = picture(context, torus, **SCENES[name])
    called = renderer.resolution
    assert read == set(called.columns)
    shown = {"reconstructed": ["numbered.frag", "faces"]}.get(name, ["faces", "sprites"])
    compiled = dict(renderer.painter.programs.compiled)
    defines = {}
    for program in compiled.values():
        defines |= {key: value for key, value in program.items() if key not in OWN}
    assert defines == dict(called.defines)
    assert any(program in compiled for program in shown)
    assert set(renderer.log) == set(called.passes)


def test_no_program_is_compiled_that_is_not_run(context, torus):
    _, renderer = picture(context, torus, **FLAT, budget={"occlusion": False})
    assert [name for name, _ in renderer.painter.programs.compiled] == ["sprites"]


@pytest.mark.parametrize("name", ["flat", "lit", "highlights", "stencil", "shadow"])
@pytest.mark.parametrize("form", ["sprites", "faces"])
def test_effects_that_are_not_called_for_would_change_no_pixel(
    context, torus, monkeypatch, name, form
):
    if form == "faces":
        monkeypatch.setattr(draw, "SPRITE_PIXELS", 0.0)
    least, renderer = picture(context, torus, zoom=1.5, **SCENES[name])
    tables = SCENES[name]
    shade = tables.get("shade", {"specular": 1e-30}) | {"model": "blinn-phong"}
    if name == "flat":
        shade |= {"ambient": 1.0}
    dark = {"direction": [1, 0, 0], "shadows": True, "intensity": 1e-30}
    nowhere = {"stencil": [{"centre": [90, 90, 90], "radius": 0.1}]}
    more, all_of_it = picture(
        context, torus, zoom=1.5, shade=shade,
        light=[*tables.get("light", scenes.LIGHT["light"]), dark],
        dynamic=tables.get("dynamic", nowhere),
    )  # fmt: skip
    assert {"specular", "shadow", "stencil"} <= set(all_of_it.resolution.effects)
    assert len(renderer.resolution.effects) < len(all_of_it.resolution.effects)
    assert np.array_equal(least, more)


def test_the_three_ways_of_a_stencil_show_the_same_picture(context, torus):
    tables = {"dynamic": {"stencil": [
        {"centre": [1.03, 0.01, 0.02], "radius": 0.4321},
        {"kind": "box", "low": [-1.501, -0.301, -0.501], "size": [0.9017, 0.9013, 1.003]},
    ]}}  # fmt: skip
    whole, _ = picture(context, torus)
    shown = [
        picture(context, torus, cut=cut, **tables)[0] for cut in ("shader", "memory", "upload")
    ]
    assert (shown[0] != whole).any(axis=2).sum() > 200
    assert np.array_equal(shown[0], shown[1])
    assert np.array_equal(shown[0], shown[2])


def test_a_stencil_that_removes_all_shows_the_background(context, torus):
    shown, _ = picture(context, torus, dynamic={"stencil": [{"centre": [0, 0, 0], "radius": 9.0}]})
    assert not shown[..., 3].any()


@pytest.mark.parametrize("name", ["shear", "wave"])
def test_a_deformed_surface_has_no_holes(context, torus, name):
    dynamic = SCENES[name]["dynamic"]
    file = BlockFile(open_source(str(torus.path)))
    middle = file.box.mean(axis=0)
    file.source.close()
    points = torus.points - middle
    if name == "shear":
        moved = points @ np.array(dynamic["matrix"]).T
    else:
        moved = points.copy()
        moved[:, 2] += 0.1 * np.sin(2 * np.pi * points[:, 0] / 1.5)
    model = scenes.Model(torus.path, moved + middle, torus.triangles)
    for direction in np.random.default_rng(1).normal(size=(6, 3)):
        shown, renderer = picture(context, model, direction, **SCENES[name])
        silhouette = scenes.Silhouette(context, model, renderer.file, SIZE)
        silhouette.box = renderer._box()
        camera = scenes.camera_from(renderer.file, direction, SIZE)
        assert scenes.holes(shown, silhouette(camera)) == 0


def test_a_shadow_falls_where_the_light_is_blocked_and_nowhere_else(context, tmp_path):
    # A square above a larger one: its shadow, straight below it, is the square.
    def square(half, z):
        return [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]

    points = np.array(square(1.0, 0.003) + square(0.4, 0.603), float)
    triangles = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    model = scenes.build(
        tmp_path, "squares", (points, triangles), resolution=128, block=16, faces="both"
    )
    light = {"direction": [0, 0, -1]}
    # Seen from the side, from above the large square and below the small one.
    view = {"direction": (1.0, 0.0, 0.15)}
    bright, _ = picture(context, model, **view, light=[light])
    dark, renderer = picture(context, model, **view, light=[light | {"shadows": True}])
    shadow = (bright[..., 0].astype(int) - dark[..., 0]) > 60
    floor = (bright[..., 3] > 0) & (bright[..., 0] > 150)
    share = shadow.sum() / (floor.sum())
    assert 0.1 < share < 0.3
    assert renderer.log[0] == "shadow"


def test_a_point_light_within_the_scene_cannot_have_shadows_here(context, torus):
    light = [{"kind": "point", "position": [0, 0, 0.1], "shadows": True}]
    with pytest.raises(Exception, match=r"light\[0\]\.shadows: a point light within"):
        picture(context, torus, light=light)


def test_a_column_that_the_file_lacks_is_refused_by_name():
    facts = Facts(columns=frozenset({"occupancy", "mask"}), levels=3, blocks=9)
    with pytest.raises(RefusedSceneError, match="normal") as caught:
        resolve(scene_of({"light": [{"direction": [0, 0, -1]}]}), facts)
    assert caught.value.column == "normal"


@pytest.mark.parametrize("sraa", [False, True])
def test_more_samples_give_edges_more_shades_and_leave_flat_regions_as_they_are(
    context, torus, sraa
):
    single, _ = picture(context, torus, **FLAT)
    several, _ = picture(context, torus, **FLAT, camera={"samples": 4, "sraa": sraa})
    background = single[0, 0, 0]
    surface = single[single[..., 3] > 0][0, 0]
    shades = np.unique(several[..., 0])
    assert len(np.unique(single[..., 0])) == 2
    assert len(shades) == 5, "four samples: five shades of an edge"
    assert background in shades
    assert surface in shades
    inside = scenes.eroded(single[..., 3] > 0, by=3)
    assert (several[inside][:, 0] == surface).all()


def test_reconstruction_is_near_to_shading_every_sample(context, torus):
    msaa, _ = picture(context, torus, camera={"samples": 4})
    sraa, _ = picture(context, torus, camera={"samples": 4, "sraa": True})
    single, _ = picture(context, torus)

    def error(a):
        return float(np.sqrt(np.mean((a[..., :3].astype(float) - msaa[..., :3]) ** 2)))

    assert error(sraa) < 0.5 * error(single)


def test_a_lone_resolution_draws_what_a_resolved_scene_does(context, torus):
    """Painter and Renderer take the resolver's word: an empty one draws plain voxels."""
    file = BlockFile(open_source(str(torus.path)))
    scene = scene_of({"budget": {"io": "sync"}})
    plain = Resolution(("visibility",), ("occupancy", "mask"), (), ("voxels",), {}, {})
    renderer = Renderer(context, file, scene, plain, SIZE)
    renderer.converge(scenes.camera_from(file, (1, 0, 0), SIZE))
    assert renderer.painter.programs.compiled == [("sprites", {"SPRITES": 1})]
    renderer.close()
