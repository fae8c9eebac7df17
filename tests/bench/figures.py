"""What is computed from measurements: power laws, rates, the least time a disk allows."""

import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PowerLaw:
    """y = factor * x ** slope."""

    slope: float
    factor: float

    def at(self, x: float) -> float:
        return self.factor * float(x) ** self.slope


def power_law(points: Iterable[tuple[float, float]]) -> PowerLaw | None:
    """The line through the logarithms of (x, y) with the least squares of log y.

    None of fewer than two different x. Points that are not positive have no logarithm: left out.
    """
    logs = [(math.log(x), math.log(y)) for x, y in points if x > 0 and y > 0]
    if len({x for x, _ in logs}) < 2:
        return None
    middle_x, middle_y = (sum(values) / len(logs) for values in zip(*logs, strict=True))
    spread = sum((x - middle_x) ** 2 for x, _ in logs)
    slope = sum((x - middle_x) * (y - middle_y) for x, y in logs) / spread
    return PowerLaw(slope, math.exp(middle_y - slope * middle_x))


@dataclass(frozen=True, slots=True)
class DiskRate:
    """What the disk did, bytes per second."""

    read: float
    write: float

    def seconds(self, read_bytes: float, written_bytes: float) -> float:
        """How long the disk needs for that many bytes, one after the other."""
        return read_bytes / self.read + written_bytes / self.write


def least_seconds(
    rate: DiskRate, input_bytes: float, scratch_bytes: float, output_bytes: float
) -> float:
    """The lower bound: input read once, scratch written and read once, output written once."""
    return rate.seconds(input_bytes + scratch_bytes, scratch_bytes + output_bytes)


def per(amount: float, of: float | None) -> float | None:
    """`amount / of`; None of nothing."""
    return amount / of if of else None
