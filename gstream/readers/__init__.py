"""Readers: other people's meshes become arrays on disk; content tells the format, then the name."""

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gstream.errors import InputError, UsageError
from gstream.readers import obj, off, ply, stl, stl_text
from gstream.readers.inflate import inflate
from gstream.readers.mesh import Mesh
from gstream.readers.scratch import Spill

SUFFIXES = (".ply", ".stl", ".obj", ".off")  # each also with .gz
READS = "gstream reads PLY, STL, OBJ and OFF, each also as .gz"
HEAD = 1024  # bytes that decide the format
OFF_MAGIC = re.compile(rb"(?:\s|#[^\r\n]*[\r\n])*(?:ST)?C?N?4?n?OFF\b")


def open_mesh(path: Path, spill: Spill) -> Mesh:
    """Open one input; nothing of a mesh that can be mapped is read, the rest is spilled in blocks.

    path: a regular file, of any of SUFFIXES or told by its content.
    spill: gives the path of a scratch file of this input by its name.
    Raises UsageError when the path cannot be read, InputError when its content cannot be.
    """
    name = str(path)
    with _named_by_a_user(path):
        kind, plain = sniff(path, name, path.suffix), path
    if kind == "gz":
        plain = inflate(path, name, spill("inflated"))
        kind = sniff(plain, name, Path(path.stem).suffix)
    mesh = _open(kind, plain, name, path.parent, spill)
    if plain is not path and not mesh.lies_in(plain):
        plain.unlink()
    if mesh.triangle_count == 0:
        thin = (
            f", only {mesh.skipped_faces} points, lines or smaller ones"
            if mesh.skipped_faces
            else ""
        )
        said = f"has no faces{thin}"
        raise InputError(name, "", said, "give a mesh with triangles")
    return mesh


def _open(kind: str, path: Path, name: str, folder: Path, spill: Spill) -> Mesh:
    match kind:
        case "ply":
            return ply.open_ply(path, name, spill)
        case "stl binary":
            return stl.open_binary(path, name)
        case "stl ascii":
            return stl_text.open_text(path, name, spill)
        case "off":
            return off.open_off(path, name, spill)
        case "obj":
            return obj.open_obj(path, name, folder, spill)
    raise InputError(name, "", "is compressed twice", "decompress it once")


def needs_spill(path: Path) -> bool:
    """Whether open_mesh will write scratch files, from the file's head and its first faces."""
    with _named_by_a_user(path):
        kind = sniff(path, str(path), path.suffix)
    if kind == "ply":
        return ply.needs_spill(path, str(path))
    return kind != "stl binary"


def sniff(path: Path, name: str, suffix: str) -> str:
    """gz, ply, stl binary, stl ascii, obj or off; `suffix` decides where content cannot."""
    head, size = _head(path)
    suffix = suffix.lower()
    if not size:
        raise InputError(name, "", "is empty", "copy the file again")
    if head.startswith(b"\x1f\x8b"):
        return "gz"
    if head.startswith(b"version https://git-lfs"):
        said = "is a Git LFS pointer, not the mesh itself"
        raise InputError(name, "", said, "run 'git lfs pull' where it comes from")
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(name, "byte 0", "is UTF-16 text", "save it as UTF-8 or ASCII")
    if re.match(rb"ply[ \t]*[\r\n]", head):
        return "ply"
    if OFF_MAGIC.match(head) and suffix != ".obj":
        return "off"
    if suffix == ".stl" and head.isascii() and b"\0" not in head and not _solid(head):
        raise InputError(name, "line 1", "is text without the word 'solid'", "export it again")
    if (stl_kind := _stl(head, size, suffix)) is not None:
        return stl_kind
    if suffix in (".obj", ".off"):
        return suffix[1:]
    if suffix == ".ply":
        raise InputError(name, "line 1", "the first line is not 'ply'", "export it again")
    raise InputError(name, "", "is of no known mesh format", READS)


def _stl(head: bytes, size: int, suffix: str) -> str | None:
    """Binary when the size is 84 + 50 n, even after 'solid'; exporters write that word in both."""
    count = stl.promised_triangles(head)
    promised = stl.HEAD + stl.RECORD * count if count >= 0 else -1
    if size == promised and (suffix not in (".obj", ".off") or b"\0" in head):
        return "stl binary"
    if _solid(head):
        return "stl binary" if b"\0" in head and size >= stl.HEAD else "stl ascii"
    return "stl binary" if suffix == ".stl" else None


def _solid(head: bytes) -> bool:
    return head.lstrip()[:5].lower() == b"solid"


def _head(path: Path) -> tuple[bytes, int]:
    """The first bytes and the size of a regular file."""
    info = os.stat(path)
    if not stat.S_ISREG(info.st_mode):
        raise UsageError(f"{path}: is not a file", "give the files themselves")
    with open(path, "rb") as file:
        return file.read(HEAD), info.st_size


@contextmanager
def _named_by_a_user(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        said = f"{path}: cannot be read ({error.strerror})"
        raise UsageError(said, "give a path that exists and that you may read") from error
