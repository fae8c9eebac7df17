"""How a running job talks to whoever watches it. What it looks like is the business of `cli/`."""

from typing import Protocol


class Progress(Protocol):
    """Told of every stage and unit, always from the main thread of the parent process."""

    def note(self, said: str) -> None:
        """One line of talk: where the job's folder is, what was resumed, what was planned."""

    def stage_begins(self, stage: str, units: int, cost: float) -> None:
        """`units` of a total estimated `cost` are still to be done."""

    def unit_done(self, stage: str, cost: float) -> None:
        """One unit of that estimated cost is finished."""

    def stage_ends(self, stage: str, seconds: float) -> None:
        """All units are done and the stage has counted them."""


class Silent:
    """Progress for nobody."""

    def note(self, said: str) -> None:
        pass

    def stage_begins(self, stage: str, units: int, cost: float) -> None:
        pass

    def unit_done(self, stage: str, cost: float) -> None:
        pass

    def stage_ends(self, stage: str, seconds: float) -> None:
        pass
