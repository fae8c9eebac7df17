"""Decompressing a .gz to scratch, in blocks; the standard library checks its CRC and length."""

import gzip
import os
import zlib
from pathlib import Path

from gstream.errors import InputError

BLOCK = 4 << 20  # bytes


def inflate(path: Path, name: str, to: Path) -> Path:
    """Write the content of the gzip file `path` to `to`; InputError when it is cut or damaged."""
    written = 0
    to.parent.mkdir(parents=True, exist_ok=True)
    try:
        with gzip.open(path, "rb") as source, open(to, "wb") as target:
            while block := source.read(BLOCK):
                target.write(block)
                written += len(block)
            target.flush()
            os.fsync(target.fileno())
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        said = f"is damaged or cut ({error})"
        place = f"byte {written} of the decompressed data"
        raise InputError(name, place, said, "copy the .gz file again") from error
    return to
