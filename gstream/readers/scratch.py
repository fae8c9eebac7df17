"""Writing arrays of unknown length to scratch, block by block."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gstream.readers.mesh import DiskArray

Spill = Callable[[str], Path]  # a name, unique in one input -> the path of its scratch file


class Column:
    """A scratch file that grows by rows; `close()` gives the array.

    The unit that spills publishes only the mesh's description, after every column is closed, so a
    column that was cut off is never read.
    """

    def __init__(self, path: Path, dtype: str, width: int) -> None:
        self.path, self.dtype, self.width = path, np.dtype(dtype), width
        self.rows = 0
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = open(path, "wb")  # noqa: SIM115  closed by close()

    def append(self, rows: npt.NDArray[Any]) -> None:
        """Append rows of shape (n, width), converted to the column's type."""
        block = np.ascontiguousarray(rows, self.dtype)
        self._file.write(block.data)
        self.rows += len(block)

    def close(self) -> DiskArray:
        self._file.close()
        size = self.dtype.itemsize
        strides = (size * self.width, size)
        return DiskArray(
            str(self.path), 0, self.dtype.str, (self.rows, self.width), strides
        )
