"""Compiling every reader's kernels, by reading one triangle of each kind of file that is spilled."""

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from gstream.readers import open_mesh

SAMPLES = {
    "a.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "b.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty uchar x\n"
    b"property uchar y\nproperty uchar z\nelement face 1\n"
    b"property list uchar uchar vertex_indices\nend_header\n" + bytes(12) + b"\4\0\1\2\3",
    "a.stl": b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    b"endloop\nendfacet\nendsolid a\n",
    "a.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n",
}


def warm_readers() -> None:
    """Read the samples in a temporary folder; what they hold does not matter."""
    with TemporaryDirectory(prefix="gstream-warm-") as folder:
        for name, content in SAMPLES.items():
            path = Path(folder) / name
            path.write_bytes(content)
            open_mesh(path, partial(_beside, path))


def _beside(path: Path, label: str) -> Path:
    return path.with_name(f"{path.name}-{label}")
