"""What a scene calls for, as the settings of a job that makes a block file for it."""

from dataclasses import replace

from gstream.formats.cells import grid_of_stream
from gstream.formats.stream import StreamReader
from gstream.grid import MAX_RESOLUTION, Grid
from gstream.job import VoxelizeSettings
from gstream.scene import Facts, Resolution, Scene, resolve

Wanted = tuple[VoxelizeSettings, Resolution]
MADE = frozenset({"occupancy", "mask", "normal", "geometry"})  # of any mesh
ATTRIBUTES = ("normal", "colour")


def wanted_of_stream(scene: Scene, settings: VoxelizeSettings, stream: str) -> Wanted:
    """The settings with the columns and levels that the scene calls for, and why.

    errors : UsageError, UnsupportedError of the scene (gstream.scene.resolve) or of the grid;
        CorruptFileError of the stream
    """
    reader = StreamReader(stream)
    resolution = settings.resolution or MAX_RESOLUTION
    if settings.resolution is None and reader.box is not None:
        low, high = reader.box
        box = ((low[0], low[1], low[2]), (high[0], high[1], high[2]))
        resolution = grid_of_stream(box, reader.metadata, settings).resolution
    names = {attribute.name for attribute in reader.attributes}
    return _wanted(scene, settings, MADE | (names & {"colour"}), resolution)


def wanted_of_meshes(scene: Scene, settings: VoxelizeSettings) -> Wanted:
    """The same before meshes were read: if they have colours, and how large they are, is not known.

    Colours that the scene requires are asked for again when the meshes' stream is there.
    """
    resolution = settings.resolution or MAX_RESOLUTION
    return _wanted(scene, settings, MADE | {"colour"}, resolution)


def _wanted(
    scene: Scene, settings: VoxelizeSettings, columns: frozenset[str], resolution: int
) -> Wanted:
    levels = Grid(resolution, 1.0, (0.0, 0.0, 0.0), 0).level_count(settings.block)
    found = resolve(scene, Facts(columns, levels if settings.lod else 1))
    required = scene.tables["source"]["colours"] == "required"
    made = replace(
        settings,
        columns=tuple(name for name in ATTRIBUTES if name in found.columns),
        required=("colour",) if required else (),
        lod="lod" in found.effects,
        keep_geometry=settings.keep_geometry or "hybrid" in found.effects,
    )
    return made, found
