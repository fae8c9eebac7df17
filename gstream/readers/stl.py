"""Binary STL: mapped, whatever its header says. ASCII STL is in stl_text."""

from pathlib import Path

import numpy as np

from gstream.errors import InputError
from gstream.readers.mesh import DiskArray, Mesh

HEAD = 84  # 80 bytes of anything, then the count
RECORD = 50  # normal 3 f4, corners 9 f4, attribute u2


def promised_triangles(head: bytes) -> int:
    """The count in the header of a binary STL; -1 when `head` is too short for one."""
    return int.from_bytes(head[80:HEAD], "little") if len(head) >= HEAD else -1


def open_binary(path: Path, name: str) -> Mesh:
    """Map a binary STL of n triangles as a (n, 3, 3) little-endian f4 soup.

    Bytes after the last record are tolerated and noted; normals and attributes are not read.
    """
    size = path.stat().st_size
    with open(path, "rb") as file:
        count = promised_triangles(file.read(HEAD))
    if count < 0:
        said = f"{size} bytes are fewer than the {HEAD} of an STL header"
        raise InputError(name, f"byte {size}", said, "copy the file again")
    if size < HEAD + RECORD * count:
        whole = (size - HEAD) // RECORD
        said = f"the header promises {count} triangles, the file ends in number {whole}"
        raise InputError(name, f"byte {size}", said, "copy the file again")
    trailing = size - HEAD - RECORD * count
    positions = DiskArray(
        str(path.absolute()), HEAD + 12, np.dtype("<f4").str, (count, 3, 3), (RECORD, 12, 4)
    )
    notes = {"trailing_bytes": trailing} if trailing else {}
    return Mesh(name, positions, None, count, faces=count, notes=notes)
