"""ASCII STL, spilled as a soup of f8 corners."""

import re
from pathlib import Path

import numpy as np

from gstream.errors import InputError
from gstream.kernels import text as kernel
from gstream.readers.mesh import DiskArray, Mesh
from gstream.readers.scratch import Column, Spill
from gstream.readers.text_blocks import TextBlocks

TAIL = 4096  # bytes that hold the last line
FACETS = 1 << 13  # facets per batch
REMEDY = "correct the line, or export the STL file again"


def open_text(path: Path, name: str, spill: Spill) -> Mesh:
    """Read every solid of an ASCII STL with any line ends; normals are not read."""
    column = Column(spill("positions"), "<f8", 9)
    corners = np.empty((FACETS, 9))
    slow = np.empty((9 * FACETS, 3), np.int64)
    with open(path, "rb") as file:
        blocks = TextBlocks(file, name)
        more = True
        while more:
            parsed = kernel.parse_facets(blocks.text, 0, blocks.stop, corners, slow)
            count, waiting, used, code, at = (int(v) for v in parsed)
            if code not in (kernel.MORE_TEXT, kernel.FULL):
                raise _wrong(blocks, code, at)
            blocks.round_slow(corners.reshape(-1), slow[:waiting])
            column.append(corners[:count])
            more = blocks.use(used)
        rest = blocks.text[used : blocks.stop].tobytes()
        inside = "inside a facet" if rest.strip() else "without endsolid"
        if rest.strip() or not _is_closed(path):
            raise blocks.error(blocks.last(), f"the file ends {inside}", "copy it again")
    soup = column.close()
    positions = DiskArray(soup.path, 0, soup.dtype, (soup.shape[0], 3, 3), (72, 24, 8))
    return Mesh(name, positions, None, soup.shape[0], faces=soup.shape[0])


def _is_closed(path: Path) -> bool:
    """Whether the last line is an endsolid: a file cut between two facets shows it nowhere else."""
    with open(path, "rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL))
        return re.search(rb"end[ \t]*solid[^\r\n]*\s*\Z", file.read(), re.IGNORECASE) is not None


def _wrong(blocks: TextBlocks, code: int, at: int) -> InputError:
    token = blocks.token(at)
    said = {
        kernel.BAD_WORD: f"{token} is no word of an ASCII STL",
        kernel.BAD_COORDINATE: f"{token} is not a coordinate",
        kernel.BAD_FACET: f"{token} stands where a facet of three vertices does not allow it",
    }[code]
    return blocks.error(at, said, REMEDY)
