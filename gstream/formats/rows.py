"""Row files: the directory rows of merged piles, as scratch for simplify and pack.

A row file is an array of pile rows in ascending (level, key), with the names of the piles that
`pile` numbers beside it as JSON. Scratch, no public format.
"""

import json
from collections.abc import Collection, Sequence

import numpy as np

from gstream.formats.columns import ColumnSpec, column_specs
from gstream.formats.directory import Rows, pile_dtype
from gstream.formats.pieces import piece_specs


def pipeline_columns(
    names: Collection[str], normal_bits: int, vertex_bits: int = 0
) -> tuple[ColumnSpec, ...]:
    """The columns that piles carry: of these names (Scene.columns), as the spec orders them.

    vertex_bits : of source triangles, 0 where these are not kept
    """
    pieces = piece_specs(vertex_bits).values() if vertex_bits else ()
    specs = column_specs(normal_bits)
    return (*(spec for name, spec in specs.items() if name in names), *pieces)


def rows_from_bytes(data: bytes, columns: Sequence[ColumnSpec]) -> Rows:
    """Rows of a row file, or of a run of it."""
    return np.frombuffer(data, pile_dtype(columns)).copy()


def block_range(row: np.void, columns: Sequence[ColumnSpec]) -> tuple[int, int]:
    """Offset and length of the run of a pile that holds all stored columns of a block."""
    stored = [row[c.field] for c in columns if row[c.field]["stored"]]
    if not stored:
        return 0, 0
    first = min(int(r["offset"]) for r in stored)
    return first, max(int(r["offset"]) + int(r["stored"]) for r in stored) - first


def names_json(names: Sequence[str]) -> bytes:
    """The names of the piles, in the order of their numbers."""
    return json.dumps(list(names)).encode()
