"""One finding of a check: which rule of a spec a file breaks, and where."""

from dataclasses import dataclass
from typing import Final

ERROR: Final = "error"
WARNING: Final = "warning"
NOTE: Final = "note"


@dataclass(frozen=True, slots=True)
class Finding:
    """A rule's id, its severity (error, warning or note), a place and a sentence."""

    rule: str
    severity: str
    place: str
    said: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.place}: {self.said} [{self.rule}]"
