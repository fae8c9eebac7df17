"""Compiling readers' kernels in the parent, by reading one triangle of each kind of file."""

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from gstream.readers import open_mesh

_PLY = (
    b"ply\nformat %s 1.0\nelement vertex 4\nproperty uchar x\nproperty uchar y\nproperty uchar z\n"
    b"element face 1\nproperty list uchar uchar vertex_indices\nend_header\n"
)
SAMPLES = {
    ".ply": (
        _PLY % b"ascii" + b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n4 0 1 2 3\n",
        _PLY % b"binary_little_endian" + bytes(12) + b"\4\0\1\2\3",
    ),
    ".stl": (
        b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
        b"endloop\nendfacet\nendsolid a\n",
    ),
    ".obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n",),
    ".off": (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",),
}


def warm_readers(suffixes: Iterable[str]) -> None:
    """Read the samples for `suffixes` in a temporary folder; an unknown suffix stands for all."""
    wanted = {suffix.lower() for suffix in suffixes}
    if not wanted <= SAMPLES.keys():
        wanted = set(SAMPLES)
    with TemporaryDirectory(prefix="gstream-warm-") as folder:
        for suffix in sorted(wanted):
            for number, content in enumerate(SAMPLES[suffix]):
                path = Path(folder) / f"{number}{suffix}"
                path.write_bytes(content)
                open_mesh(path, partial(_beside, path))


def _beside(path: Path, label: str) -> Path:
    return path.with_name(f"{path.name}-{label}")
