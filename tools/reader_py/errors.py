"""The ways in which a file is refused."""


class CorruptFileError(Exception):
    """Bytes break a rule of the spec; `rule` is its id in spec/rules.md."""

    def __init__(self, rule: str, said: str, where: str) -> None:
        super().__init__(rule, said, where)
        self.rule, self.said, self.where = rule, said, where

    def __str__(self) -> str:
        return f"{self.where}: {self.said} [{self.rule}]"


class UnsupportedError(Exception):
    """The file, or the column that was asked for, needs a newer reader or is not there."""


class SourceError(OSError):
    """The bytes cannot be had: the network, a server without ranges, a file that has changed."""
