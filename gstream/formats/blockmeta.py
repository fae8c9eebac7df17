"""The metadata of a block file: JSON text <-> object. Layout: spec/blockfile.md, section 9."""

import json
from collections.abc import Mapping
from typing import Any, Final

from gstream.errors import CorruptFileError
from gstream.formats.framing import parse_object

MAX_META_BYTES: Final = 12 << 10


def meta_bytes(metadata: Mapping[str, Any]) -> bytes:
    """The META section: UTF-8 JSON with sorted keys and no white space."""
    text = json.dumps(
        metadata, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False
    )
    return text.encode()


def parse_metadata(data: bytes, at: int, path: str) -> dict[str, Any]:
    """The META object; units, up and crs are strings or null, the ledger is an object."""
    metadata: dict[str, Any] | None = None
    if len(data) <= MAX_META_BYTES:
        try:
            metadata = parse_object(data)
        except ValueError as error:
            raise CorruptFileError("GSB-0205", path, at, "the metadata is no UTF-8 JSON") from error
    if metadata is None or not isinstance(metadata.get("ledger"), dict):
        said = f"the metadata is no JSON object of at most {MAX_META_BYTES} bytes with a ledger"
        raise CorruptFileError("GSB-0205", path, at, said)
    for name in ("units", "up", "crs"):
        if not isinstance(metadata.get(name), str | None):
            raise CorruptFileError("GSB-0205", path, at, f"{name} is neither a string nor null")
    return metadata
