"""A streaming reader of block files: knows spec/blockfile.md alone, reads by byte ranges."""

from .blockfile import BlockFile
from .columns import unit_normals
from .directory import block_places
from .errors import CorruptFileError, SourceError, UnsupportedError
from .source import open_source

__all__ = [
    "BlockFile",
    "CorruptFileError",
    "SourceError",
    "UnsupportedError",
    "block_places",
    "open_source",
    "unit_normals",
]
