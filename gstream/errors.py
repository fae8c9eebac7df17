"""Every error that gstream raises on purpose, each with its exit code.

One line each: file, place, what is wrong, the rule's id, what to do. Constructor parameters are the
exception's `args`, so that an error raised in a worker process pickles back to the parent whole.
"""


class GstreamError(Exception):
    """Base of all errors raised on purpose; `exit_code` is the process' exit status."""

    exit_code = 1


class AdvisedError(GstreamError):
    """What is wrong, and what to do."""

    def __init__(self, said: str, remedy: str = "") -> None:
        super().__init__(said, remedy)
        self.said, self.remedy = said, remedy

    def __str__(self) -> str:
        return f"{self.said}; {self.remedy}" if self.remedy else self.said


class UsageError(AdvisedError):
    """An option, a path that cannot be read, or an output that exists already."""

    exit_code = 2


class StoppedError(AdvisedError):
    """The job stopped midway (disk full, killed, failed unit); the same command resumes it."""

    exit_code = 3


class SceneError(AdvisedError):
    """A scene whose numbers no grid can hold, whatever the options are."""

    exit_code = 4


class InputError(GstreamError):
    """Another program's file (PLY, STL, OBJ, OFF) is invalid at a place that a person can find."""

    exit_code = 4

    def __init__(self, path: str, place: str, said: str, remedy: str) -> None:
        super().__init__(path, place, said, remedy)
        self.path, self.place, self.said, self.remedy = path, place, said, remedy

    def __str__(self) -> str:
        where = f"{self.path}: {self.place}" if self.place else self.path
        return f"{where}: {self.said}; {self.remedy}"


class CorruptFileError(GstreamError):
    """A file of ours breaks a rule of the spec; `rule` is the rule's id, `at` a byte offset."""

    exit_code = 4

    def __init__(self, rule: str, path: str, at: int, said: str) -> None:
        super().__init__(rule, path, at, said)
        self.rule, self.path, self.at, self.said = rule, path, at, said

    def __str__(self) -> str:
        return (
            f"{self.path}: {self.said}, at byte {self.at} [{self.rule}]; rebuild or recopy the file"
        )


class RefusedError(AdvisedError):
    """Refused before the start: the job does not fit the memory or the disk it was given."""

    exit_code = 5


class UnsupportedError(GstreamError):
    """A version, feature, codec, filter or column that this release cannot handle."""

    exit_code = 6

    def __init__(self, path: str, said: str, remedy: str) -> None:
        super().__init__(path, said, remedy)
        self.path, self.said, self.remedy = path, said, remedy

    def __str__(self) -> str:
        return f"{self.path}: {self.said}; {self.remedy}"
