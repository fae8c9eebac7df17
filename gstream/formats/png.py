"""Pixels -> the bytes of a PNG, with the standard library alone.

Source: Portable Network Graphics (PNG) Specification, third edition, sections 5, 9 and 11.
"""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Shorts = NDArray[np.int16]

SIGNATURE = b"\x89PNG\r\n\x1a\n"
BAND = 64  # rows filtered at once


def png(rgb: Bytes) -> bytes:
    """An 8-bit sRGB PNG of (h, w, 3) codes."""
    height, width, _ = rgb.shape
    flat = rgb.reshape(height, width * 3)
    packer = zlib.compressobj(6)
    data = [packer.compress(_filtered(flat, y).tobytes()) for y in range(0, height, BAND)]
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = b"".join([*data, packer.flush()])
    parts = ((b"IHDR", header), (b"sRGB", b"\0"), (b"IDAT", body), (b"IEND", b""))
    return SIGNATURE + b"".join(_chunk(kind, content) for kind, content in parts)


def _filtered(flat: Bytes, first: int) -> Bytes:
    """BAND rows from `first`, each with the filter of the smallest residues, as libpng does."""
    rows = flat[first : first + BAND].astype(np.int16)
    above = np.zeros_like(rows)
    above[1:] = rows[:-1]
    if first:
        above[0] = flat[first - 1]
    left, corner = np.zeros_like(rows), np.zeros_like(rows)
    left[:, 3:], corner[:, 3:] = rows[:, :-3], above[:, :-3]
    guesses = (np.zeros_like(rows), left, above, (left + above) // 2, _paeth(left, above, corner))
    residues = np.stack([rows - guess for guess in guesses]).astype(np.uint8)
    best = np.abs(residues.view(np.int8).astype(np.int16)).sum(axis=2).argmin(axis=0)
    return np.column_stack([best.astype(np.uint8), residues[best, np.arange(len(rows))]])


def _paeth(left: Shorts, above: Shorts, corner: Shorts) -> Shorts:
    to_left, to_above = np.abs(above - corner), np.abs(left - corner)
    to_corner = np.abs(left + above - 2 * corner)
    first = (to_left <= to_above) & (to_left <= to_corner)
    return np.where(first, left, np.where(to_above <= to_corner, above, corner))


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
