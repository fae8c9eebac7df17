"""A rule of a spec, and one finding of a check: which rule a file breaks, and where."""

from dataclasses import dataclass
from typing import Final

from gstream.errors import CorruptFileError

ERROR: Final = "error"
WARNING: Final = "warning"
NOTE: Final = "note"

READER: Final = "reader"  # whoever decodes must notice a broken rule
VALIDATOR: Final = "validator"  # only a full check must


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of spec/blockfile.md or spec/stream.md, as spec/rules.md lists it."""

    id: str
    severity: str
    noticed_by: str  # READER or VALIDATOR
    section: str  # of its page, where it is explained
    sentence: str


@dataclass(frozen=True, slots=True)
class Finding:
    """A rule's id, its severity (error, warning or note), a place and a sentence."""

    rule: str
    severity: str
    place: str
    said: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.place}: {self.said} [{self.rule}]"


def broken(error: CorruptFileError) -> Finding:
    """The finding of an error that reading met."""
    return Finding(error.rule, ERROR, f"byte {error.at}", error.said)
