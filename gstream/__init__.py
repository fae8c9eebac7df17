"""Out-of-core voxel preprocessing: triangle meshes in, one streamable block file out.

The Python API: `build`, `open` and `check`. Nothing heavy is imported before it is called.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence

    from gstream.check import Report
    from gstream.read import BlockFile
    from gstream.run.pipeline import RunReport
    from gstream.run.progress import Progress

__version__ = "0.1.0"


def build(
    inputs: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    *,
    ingest: Mapping[str, Any] | None = None,
    scene: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    memory: int = 2 << 30,
    tmp: str | None = None,
    force: bool = False,
    restart: bool = False,
    progress: Progress | None = None,
    **voxelize: Any,
) -> RunReport:
    """Build the block file `output` from one mesh or several.

    ingest : fields of `gstream.job.IngestSettings` beside the inputs
    scene : a scene file (spec/scene.md); only what it calls for is stored
    voxelize : fields of `gstream.job.VoxelizeSettings`: resolution or voxel_size (one of them is
        needed), snap_bits, sep, ties, block, lod, keep_weights, keep_geometry, columns, required,
        faces, normals, normal_bits, lz4, cell
    workers : processes, 0 = this one, None = one per processor
    memory : bytes for all processes together
    tmp : folder for scratch; None = $TMPDIR, else the output's folder
    restart : drop what an earlier, stopped run for this output has done
    progress : called with each event of the job (gstream.run.progress), from any thread
    errors : GstreamError, as the command line has them (gstream.errors)
    """
    import os

    from gstream.job import IngestSettings, VoxelizeSettings
    from gstream.run import commands

    paths = [inputs] if isinstance(inputs, str | os.PathLike) else list(inputs)
    request = commands.build(
        IngestSettings(inputs=tuple(os.fspath(path) for path in paths), **dict(ingest or {})),
        VoxelizeSettings(**voxelize),
        os.fspath(output),
        commands.RunOptions(workers=workers, memory=memory, tmp=tmp, force=force, restart=restart),
        None if scene is None else os.fspath(scene),
    )
    return request.run(progress)


def open(path: str | os.PathLike[str]) -> BlockFile:
    """Open a block file: iterate its levels and blocks, read a block by key or a region by box.

    path : also a URL (https://, s3://, …) with the extra `remote`; only ranges are requested
    errors : UsageError for what cannot be read; CorruptFileError, UnsupportedError; of a URL also
        StoppedError, whenever the network fails or the file is another one by now
    """
    from gstream.compiled import READING
    from gstream.read import open_block_file

    return open_block_file(path, choose=READING)


def check(path: str | os.PathLike[str], *, quick: bool = False) -> Report:
    """Check a block file or a geometry stream against the spec; `quick` = structure and indexes.

    returns : a report; `ok` where no rule is broken, `findings` with every error and note
    """
    from gstream.check import check_file
    from gstream.compiled import CHECKING

    return check_file(path, quick, choose=CHECKING)


class _Package(ModuleType):
    """This package, in which `check` stays the function above.

    The import system binds a submodule to its package under the same name; for check.py that
    would make `gstream.check(path)` work only until somebody imports the module.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name != "check" or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
