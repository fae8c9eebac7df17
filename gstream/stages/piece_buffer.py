"""Source triangles of a box of voxels: cut while it is filled, then sorted out by block.

No stage of its own: voxelize keeps them with it.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.errors import RefusedError
from gstream.formats.pieces import MOST_ITEMS, NO_PIECES, Pieces
from gstream.kernels.pieces import ROW, Rows, cut_at_borders, indexed

PIECE_BYTES = 260  # measured: 221 where all are in one block, 102 where many blocks share them


class PieceBuffer:
    """Pieces of triangles in the blocks of one box."""

    def __init__(self, block_log2: int, room: NDArray[Any], limit_bytes: int) -> None:
        """block_log2 : log2 of a block's edge; room : (3,) extent of the box; both snap units."""
        self.block_log2, self.room, self.limit = block_log2, room, limit_bytes // PIECE_BYTES
        self.parts = [np.empty((0, ROW), np.int32)]
        self.held = 0

    def add(self, corners: NDArray[np.int64]) -> None:
        """Cut triangles, (n, 3, 3) snap units relative to the box.

        errors : BoxFullError
        """
        rows = cut_at_borders(corners, self.block_log2, self.room, self.limit - self.held)
        self.held += len(rows)
        self.parts.append(rows)

    def by_block(self) -> "PiecesByBlock":
        """What was added, sorted by block."""
        rows = np.concatenate(self.parts)
        self.parts = []
        return PiecesByBlock(rows[np.argsort(rows[:, 0], kind="stable")])


class PiecesByBlock:
    """The pieces of a box, block by block."""

    def __init__(self, rows: Rows) -> None:
        self.corners, self.blocks = rows[:, 1:], np.ascontiguousarray(rows[:, 0])
        self.left = len(rows)  # pieces that no block has taken

    def take(self, block: int) -> Pieces:
        """The pieces of one block, by its Morton code in the box.

        errors : RefusedError where they are more than a column holds
        """
        first, last = np.searchsorted(self.blocks, (block, block + 1)).tolist()
        if first == last:
            return NO_PIECES
        self.left -= last - first
        pieces = Pieces(*indexed(self.corners[first:last].reshape(-1, 3, 3)))
        if max(map(len, pieces)) > MOST_ITEMS:
            said = (
                f"one block has {len(pieces.triangles)} source triangles, too many for its column"
            )
            raise RefusedError(said, "use a smaller --block, or smaller voxels")
        return pieces
