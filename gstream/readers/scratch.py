"""Writing arrays of unknown length to scratch, block by block."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gstream.readers.mesh import DiskArray

FILL_ROWS = 1 << 18
Spill = Callable[[str], Path]  # a name, unique in one input -> the path of its scratch file


class Column:
    """A scratch file that grows by rows; `close()` gives the array.

    The file is open only while a block is written, so that an error on the way leaves none open.
    What is spilled is believed only when its unit is marked as done, after every column is closed.
    """

    def __init__(self, path: Path, dtype: str, width: int) -> None:
        self.path, self.dtype, self.width = path, np.dtype(dtype), width
        self.rows = 0
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")

    def append(self, rows: npt.NDArray[Any]) -> None:
        """Append rows of shape (n, width), converted to the column's type."""
        with np.errstate(over="ignore", invalid="ignore"):  # 1e99 as f4 is inf, counted at ingest
            block = np.ascontiguousarray(rows, self.dtype)
        with open(self.path, "ab") as file:
            file.write(block.tobytes())
        self.rows += len(block)

    def close(self) -> DiskArray:
        with open(self.path, "rb") as file:
            os.fsync(file.fileno())
        size = self.dtype.itemsize
        shape, strides = (self.rows, self.width), (size * self.width, size)
        return DiskArray(str(self.path), 0, self.dtype.str, shape, strides)


class LateColumn:
    """A column that is only written once something other than `default` is known for a row."""

    def __init__(self, path: Path, dtype: str, default: tuple[float, ...]) -> None:
        self._path, self._dtype = path, dtype
        self._default = np.array(default, dtype)
        self._pending = 0
        self._column: Column | None = None

    def pass_over(self, rows: int) -> None:
        """Append `rows` rows of the default."""
        self._pending += rows
        if self._column is not None:
            self._flush(self._column)

    def started(self) -> Column:
        """The column, for appending rows that differ."""
        if self._column is None:
            self._column = Column(self._path, self._dtype, len(self._default))
            self._flush(self._column)
        return self._column

    def close(self) -> DiskArray | None:
        """The array; None when every row is the default."""
        return self._column.close() if self._column is not None else None

    def _flush(self, column: Column) -> None:
        while self._pending:
            rows = min(self._pending, FILL_ROWS)
            column.append(np.broadcast_to(self._default, (rows, len(self._default))))
            self._pending -= rows
