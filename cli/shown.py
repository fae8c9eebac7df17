"""Text out of files, for a terminal: no name in a file moves a cursor or breaks a line."""


def shown(text: str) -> str:
    """The text with all that cannot be printed as its escape."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
