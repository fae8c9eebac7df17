"""Damaged copies of the good vectors: mutant number n is the same bytes wherever it is made.

About half have checksums that are right again, so that the damage gets past them.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random

from fuzz.anatomy import Anatomy, dissect, number

VECTORS = Path(__file__).parents[2] / "spec" / "vectors"
SLOW = {  # to be read; their many mutants would be much the same
    "blocks-full-64", "blocks-full-256", "blocks-full-page", "blocks-most-pages",
    "stream-full-chunk",
}  # fmt: skip
SOURCES = tuple(
    dissect(path.name, path.read_bytes())
    for path in sorted((VECTORS / "good").glob("*.gs[bt]"))
    if path.stem not in SLOW
)
# As many block files as streams, and of each kind small files more often, which are read faster.
WEIGHTS = tuple(
    1
    / (len(source.data) * sum(1 / len(s.data) for s in SOURCES if s.is_stream == source.is_stream))
    for source in SOURCES
)
REALS = tuple(
    struct.unpack("<Q", struct.pack("<d", real))[0]
    for real in (float("nan"), float("inf"), -float("inf"), -0.0, 5e-324, 1e308, -1.0, 0.5)
)
SNIPPETS = (
    b"[" * 64, b'{"a":' * 12, b"1e999", b"-1", b"9" * 40, b"NaN", b"null", b"true", b'"',
    b"\\u0000",
    b'"\\ud800"', b"\xff\xfe", b"\0", b"[]", b"{}", b'"voxels":0', b'"sources":', b"1.5", b",",
)  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """A damaged file, and how it came about."""

    number: int
    source: str
    how: str
    data: bytes

    @property
    def name(self) -> str:
        return f"mutant {self.number} ({self.how} of {self.source})"


def mutant(index: int) -> Mutant:
    """Mutant number `index`."""
    random = Random(index)
    (source,) = random.choices(SOURCES, WEIGHTS)
    damage = random.choice(DAMAGES)
    data = bytearray(source.data)
    damage(random, source, data)
    if damage in SEALED and random.random() < 0.9:
        source.seal(data)
    return Mutant(index, source.name, damage.__name__.removeprefix("_"), bytes(data))


def _flips(random: Random, source: Anatomy, data: bytearray) -> None:
    for _ in range(random.choice((1, 1, 2, 5, 30))):
        data[random.randrange(len(data))] ^= random.choice((1 << random.randrange(8), 255))


def _cut(random: Random, source: Anatomy, data: bytearray) -> None:
    del data[random.randrange(len(data)) :]


def _splice(random: Random, source: Anatomy, data: bytearray) -> None:
    """Put a piece of some file over a piece of this one, of the same length or another."""
    donor = random.choice((source, random.choice(SOURCES))).data
    first, length = random.randrange(len(donor)), random.choice((1, 4, 8, 32, 80, 300))
    at = random.randrange(len(data))
    gone = random.choice((0, length, length, random.randrange(300)))
    data[at : at + gone] = donor[first : first + length]


def _field(random: Random, source: Anatomy, data: bytearray) -> None:
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        _edit(random, source, data, *random.choice(source.fields))


def _edit(random: Random, source: Anatomy, data: bytearray, at: int, size: int) -> None:
    if size not in (1, 2, 4, 8):
        data[at + random.randrange(size)] = random.choice((0, 65, 255, random.randrange(256)))
        return
    old, full = number(data, at, size), 1 << 8 * size
    other = random.choice(source.fields)
    choices = (
        0, 1, 2, full - 1, full // 2, full // 2 - 1, old + 1, old - 1, 2 * old, old // 2, old + 8,
        old ^ 1 << random.randrange(8 * size), number(data, *other), len(data), len(data) - 64,
        random.randrange(full), random.choice(REALS), 1 << random.randrange(8 * size),
    )  # fmt: skip
    data[at : at + size] = (random.choice(choices) % full).to_bytes(size, "little")


def _row(random: Random, source: Anatomy, data: bytearray) -> None:
    """Swap two records of a table, or have one twice."""
    first, length = random.choice(source.rows)
    alike = [at for at, size in source.rows if size == length]
    second = random.choice(alike)
    one, two = data[first : first + length], data[second : second + length]
    data[second : second + length] = one
    if random.random() < 0.5:
        data[first : first + length] = two


def _payload(random: Random, source: Anatomy, data: bytearray) -> None:
    if not source.payloads:
        return _flips(random, source, data)
    at, length = random.choice(source.payloads)
    for _ in range(random.choice((1, 1, 2, 4))):
        spot = at + random.randrange(length)
        data[spot] = random.choice((0, 255, data[spot] ^ 1 << random.randrange(8), 240, 15))
    return None


def _text(random: Random, source: Anatomy, data: bytearray) -> None:
    at, length = random.choice(source.texts)
    snippet = random.choice(SNIPPETS)[:length]
    spot = at + random.randrange(length - len(snippet) + 1)
    data[spot : spot + len(snippet)] = snippet


def _resize(random: Random, source: Anatomy, data: bytearray) -> None:
    """Shorten or lengthen the body, and state the new length where the format states it."""
    end, length = source.body_end, random.choice((1, 7, 32, 100, 1000))
    if random.random() < 0.5:
        data[end:end] = random.randbytes(length)
    else:
        length = -min(length, end // 2)
        del data[end + length : end]
    stated = len(data).to_bytes(8, "little")
    if source.is_stream:
        data[-48:-40] = stated
        data[-40:-32] = (end + length).to_bytes(8, "little")
    else:
        data[32:40] = stated


def _field_and_payload(random: Random, source: Anatomy, data: bytearray) -> None:
    _field(random, source, data)
    _payload(random, source, data)


SEALED = (_field, _row, _payload, _text, _resize, _field_and_payload)
DAMAGES: tuple[Callable[[Random, Anatomy, bytearray], None], ...] = (
    _flips, _cut, _splice, _splice, _field, _field, _field, _field, _field, _row, _payload,
    _payload, _text, _resize, _field_and_payload,
)  # fmt: skip
