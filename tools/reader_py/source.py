"""Where the bytes come from: a local file, or a URL by range requests."""

import http.client
import re
from typing import Protocol
from urllib.parse import quote, urljoin, urlsplit

from .errors import SourceError

SECONDS = 30.0  # without a byte from the server
REDIRECTIONS = 5
MOVED = (301, 302, 303, 307, 308)
CONNECTIONS: dict[str, type[http.client.HTTPConnection]] = {
    "http": http.client.HTTPConnection,
    "https": http.client.HTTPSConnection,
}
SAFE = "%/?:@!$&'()*+,;=~"  # in a path or query, beside letters, digits, _ . -
RANGE = re.compile(r"bytes (\d+)-(\d+)/(\d+|\*)")


Bytes = bytes  # the word is an attribute of Source


class Source(Protocol):
    """Bytes of one file; one thread at a time."""

    name: str
    size: int | None  # of the whole file, in bytes; None until it is known
    requests: int
    bytes: int  # that came in answers

    def read(self, offset: int, length: int) -> Bytes:
        """At most `length` bytes, fewer only at the file's end.

        errors : OSError, in one line
        """
        ...

    def close(self) -> None: ...


def open_source(place: str) -> Source:
    """A local path, or an http(s) URL.

    errors : OSError when a local file cannot be opened; a URL is not asked before the first read
    """
    if place.lower().startswith(("http://", "https://")):
        return HttpSource(place)
    return FileSource(place)


class FileSource:
    """A local file."""

    def __init__(self, path: str) -> None:
        self.name = path
        self._file = open(path, "rb", buffering=0)  # noqa: SIM115 - closed by close()
        self.size: int | None = self._file.seek(0, 2)
        self.requests = self.bytes = 0

    def read(self, offset: int, length: int) -> bytes:
        self.requests += 1
        self._file.seek(offset)
        data = self._file.read(length)
        self.bytes += len(data)
        return data

    def close(self) -> None:
        self._file.close()


class HttpSource:
    """A file behind a URL: one connection, kept open; a change of the file is noticed."""

    def __init__(self, url: str) -> None:
        self.name = url
        self.size: int | None = None
        self.requests = self.bytes = 0
        self._tag: str | None = None
        self._connect(url)

    def _connect(self, url: str) -> None:
        try:
            parts = urlsplit(url)
            connect = CONNECTIONS[parts.scheme]
            self._connection = connect(parts.hostname or "", parts.port, timeout=SECONDS)
        except (LookupError, ValueError, http.client.InvalidURL) as error:
            raise self._error(f"{url!r} is no URL to read from") from error
        self._url = url
        self._path = quote((parts.path or "/") + "?" * bool(parts.query) + parts.query, SAFE)

    def read(self, offset: int, length: int) -> bytes:
        try:
            for _ in range(1 + REDIRECTIONS):
                answer = self._ask(offset, length)
                if answer.status not in MOVED:
                    return self._body(answer, offset, length)
                place = urljoin(self._url, answer.headers.get("Location", ""))
                self.close()
                self._connect(place)
        except (OSError, ValueError, http.client.HTTPException) as error:
            self.close()
            if isinstance(error, SourceError):
                raise
            said = str(error).strip().splitlines() or [type(error).__name__]
            raise self._error(f"cannot be read: {said[0]}") from error
        raise self._error("is redirected too often")

    def _ask(self, offset: int, length: int) -> http.client.HTTPResponse:
        """The answer to one request; asked again where the server closed an idle connection."""
        last = offset + length - 1
        headers = {"Range": f"bytes={offset}-{last}", "Accept-Encoding": "identity"}
        idle = self._connection.sock is not None
        self.requests += 1
        try:
            self._connection.request("GET", self._path, headers=headers)
            return self._connection.getresponse()
        except (ConnectionError, http.client.BadStatusLine):
            self._connection.close()
            if not idle:
                raise
        self.requests += 1
        self._connection.request("GET", self._path, headers=headers)
        return self._connection.getresponse()

    def _body(self, answer: http.client.HTTPResponse, offset: int, length: int) -> bytes:
        if answer.status == 416:  # the file ends before `offset`
            answer.read(length)
            return b""
        if answer.status == 200:
            raise self._error("the server does not send ranges: it answered with the whole file")
        if answer.status != 206:
            raise self._error(f"cannot be read: {answer.status} {answer.reason}")
        stated = RANGE.fullmatch(answer.headers.get("Content-Range", ""))
        if not stated or int(stated[1]) != offset or int(stated[2]) >= offset + length:
            raise self._error("the server sends another range than was asked for")
        self._check_same(stated[3], answer.headers.get("ETag"))
        data = answer.read(length + 1)
        self.bytes += len(data)
        if len(data) != int(stated[2]) - offset + 1:
            raise self._error(f"{len(data)} bytes came of a range of {length}")
        return data

    def _check_same(self, total: str, tag: str | None) -> None:
        """Learn length and entity tag from the first answer that has them; no other may follow."""
        size = self.size if total == "*" else int(total)
        if size != (self.size or size) or (tag or self._tag) != (self._tag or tag):
            raise self._error("is no longer the file that was opened: open it again")
        self.size, self._tag = size, tag or self._tag

    def _error(self, said: str) -> SourceError:
        return SourceError(f"{self.name}: {said}")

    def close(self) -> None:
        self._connection.close()
