"""What tells a file from another one, or from what it was: its size and hashes, and no times."""

import os
from collections.abc import Sequence
from hashlib import blake2b
from pathlib import Path

SAMPLES = 64  # blocks hashed between head and tail
SAMPLE_BYTES = 65_536


def fingerprint(path: str | Path, whole: bool = False) -> str:
    """Size and hash of a file's head, tail and 64 blocks between.

    whole : followed by the hash of all of it
    """
    size = os.path.getsize(path)
    last = size - SAMPLE_BYTES
    everything = range(0, size, SAMPLE_BYTES)
    few = size <= (SAMPLES + 2) * SAMPLE_BYTES
    sampled = everything if few else [last * i // (SAMPLES + 1) for i in range(SAMPLES + 2)]
    print_ = f"{size}-{_hash(path, sampled)}"
    return f"{print_}-{_hash(path, everything)}" if whole else print_


def agree(was: str, is_: str) -> bool:
    """Whether two fingerprints are of one file, as far as both tell: one may be of samples."""
    return was.startswith(is_) or is_.startswith(was)


def fingerprint_if_any(path: str | Path) -> str:
    """The fingerprint of a file that need not be there, be regular, or be readable."""
    try:
        return fingerprint(path) if os.path.isfile(path) else "no file"
    except OSError:
        return "no file that can be read"


def _hash(path: str | Path, offsets: Sequence[int]) -> str:
    digest = blake2b(digest_size=16)
    with open(path, "rb") as file:
        for at in offsets:
            file.seek(at)
            digest.update(file.read(SAMPLE_BYTES))
    return digest.hexdigest()
