"""What our file formats share: magics, the CRC, raw LZ4 blocks, JSON, and their limits.

Nothing here knows a field of any format. Source of the limits: formats.md, "Both files".
"""

import json
import zlib
from collections.abc import Sequence
from math import isfinite
from typing import Any, Final, NoReturn

import lz4.block

from gstream.errors import CorruptFileError

Buffer = bytes | bytearray | memoryview

STREAM_MAGIC: Final = b"\x89GST 1.0\r\n\x1a\n"
BLOCK_MAGIC: Final = b"\x89GSB 1.0\r\n\x1a\n"
PILE_MAGIC: Final = b"\x89GSP 1.0\r\n\x1a\n"

MAX_RAW: Final = 64 << 20  # bytes that one stored part may unpack to
LZ4_RATIO: Final = 255  # one byte of an LZ4 block stands for at most 255 bytes
MAX_JSON_DEPTH: Final = 64  # objects and arrays in each other
LZ4_SLACK: Final = 64  # bytes, for the first token and the last literals

CODEC_RAW: Final = 0
CODEC_LZ4: Final = 1
CODEC_CONSTANT: Final = 2


def crc32(data: Buffer) -> int:
    """CRC-32 as in zlib, PNG and gzip: polynomial 0xEDB88320, reflected, inverted."""
    return zlib.crc32(data)


def compress(data: Buffer, lz4_mode: str) -> bytes:
    """One raw LZ4 block without a size prefix; lz4_mode: fast (acceleration 1) | hc (level 9)."""
    if lz4_mode == "hc":
        packed = lz4.block.compress(data, mode="high_compression", compression=9, store_size=False)
    else:
        packed = lz4.block.compress(data, mode="default", store_size=False)
    return bytes(packed)


def check_raw_bytes(stored: int, raw: int, rule: str, path: str, at: int) -> None:
    """Refuse a stated unpacked length that no honest block of `stored` bytes can have."""
    if raw > MAX_RAW:
        said = f"{raw} unpacked bytes are above the limit of {MAX_RAW}"
        raise CorruptFileError(rule, path, at, said)
    if raw > LZ4_RATIO * stored + LZ4_SLACK:
        said = f"{stored} stored bytes cannot unpack to {raw}"
        raise CorruptFileError(rule, path, at, said)


def decompress(data: Buffer, raw_bytes: int, rule: str, path: str, at: int) -> bytes:
    """Unpack one raw LZ4 block to exactly raw_bytes; limits are checked before any allocation.

    errors: CorruptFileError(rule, path, at) for a size over the limits, a broken block, or
    another length
    """
    check_raw_bytes(memoryview(data).nbytes, raw_bytes, rule, path, at)
    try:
        unpacked = lz4.block.decompress(data, uncompressed_size=raw_bytes)
    except (lz4.block.LZ4BlockError, ValueError) as error:
        said = "the LZ4 block is broken or of another length"
        raise CorruptFileError(rule, path, at, said) from error
    if len(unpacked) != raw_bytes:
        said = f"the LZ4 block unpacks to {len(unpacked)} bytes, not {raw_bytes}"
        raise CorruptFileError(rule, path, at, said)
    return bytes(unpacked)


def parse_object(data: bytes) -> dict[str, Any]:
    """The object that a UTF-8 JSON text is.

    errors: ValueError for anything else, and for what readers disagree about or choke on: a key
    that stands twice, a number beyond binary64, half a surrogate pair, nesting above MAX_JSON_DEPTH
    """
    try:
        value = json.loads(
            data.decode(),
            object_pairs_hook=_unique,
            parse_float=_finite,
            parse_constant=_no_constant,
        )
    except RecursionError as error:
        raise ValueError("nested too deep") from error
    if not isinstance(value, dict):
        raise ValueError("no JSON object")  # noqa: TRY004
    level: list[Any] = [value]
    for _ in range(MAX_JSON_DEPTH):
        level = [child for node in level for child in _children(node)]
    if level:
        raise ValueError("nested too deep")
    if b"\\u" in data:
        json.dumps(value, ensure_ascii=False).encode()  # UnicodeEncodeError is a ValueError
    return value


def _unique(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key stands twice")
    return found


def _finite(text: str) -> float:
    if not isfinite(float(text)):
        raise ValueError(f"{text} is beyond binary64")
    return float(text)


def _no_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is no JSON")


def _children(node: Any) -> Sequence[Any]:
    if isinstance(node, dict):
        return list(node.values())
    return node if isinstance(node, list) else ()
