"""spec/vectors/later: files of a version, or with features, that come after this one.

`python -m tests.conformance.later_vectors` writes those that are not there; no test does.
"""

from pathlib import Path
from zlib import crc32

VECTORS = Path(__file__).parents[2] / "spec" / "vectors"
CRITICAL = 256 + 32 * 4 + 4  # flags of the fifth section, the first behind the body


def _good(name: str) -> bytearray:
    return bytearray((VECTORS / "good" / name).read_bytes())


def _crc(data: bytes) -> bytes:
    return crc32(data).to_bytes(4, "little")


def _inverted(data: bytes) -> bytes:
    return bytes(byte ^ 255 for byte in data)


def _block_file(name: str, at: int, value: int) -> bytes:
    """A good vector with another byte, and CRCs of head and tail that are right again."""
    data = _good(name)
    head, tail = int.from_bytes(data[28:32], "little"), len(data) - 64
    data[at] = value
    data[head - 4 : head] = data[tail + 36 : tail + 40] = _crc(data[: head - 4])
    data[-4:] = _crc(data[tail:-4])
    return bytes(data)


def _block_file_of_version_2() -> bytes:
    """All that another version may change is changed: only bytes 0 to 31 and the CRC are as now."""
    data = _good("blocks-smallest.gsb")
    head = int.from_bytes(data[28:32], "little")
    data[12] = data[14] = 2
    start = data[:32] + _inverted(data[32 : head - 4])
    return bytes(start + _crc(start) + _inverted(data[head:]))


def _stream_of_version_2() -> bytes:
    data = _good("stream-smallest.gst")
    data[12] = data[14] = 2
    return bytes(data[:16] + _inverted(data[16:]))


def _stream_with_a_feature() -> bytes:
    data = _good("stream-smallest.gst")
    header = 36 + 32 * data[28] + int.from_bytes(data[32:36], "little")
    data[19] = 128
    data[header : header + 4] = data[-20:-16] = _crc(data[:header])
    data[-16:-12] = _crc(data[-48:-16])
    return bytes(data)


LATER = {
    "version-2.gsb": _block_file_of_version_2,
    "incompatible-feature.gsb": lambda: _block_file("blocks-smallest.gsb", 19, 128),
    "critical-section.gsb": lambda: _block_file("blocks-unknown-section.gsb", CRITICAL, 1),
    "version-2.gst": _stream_of_version_2,
    "incompatible-feature.gst": _stream_with_a_feature,
}


def write_missing() -> None:
    """Write the vectors that are not there."""
    for name, make in LATER.items():
        path = VECTORS / "later" / name
        if not path.exists():
            path.write_bytes(make())


if __name__ == "__main__":
    write_missing()
