"""Ranges of a file behind a URL, through fsspec (the extra `remote`): nothing else is requested.

HTTP goes through fsspec's session; s3:// and any other scheme through fsspec's file of that store.
"""

import os
import re
import time
from collections.abc import Callable
from typing import Any, Final

from gstream.errors import StoppedError, UsageError

RETRY_SECONDS: Final = (0.5, 2.0)  # before the second try and the third
TRANSIENT: Final = {408, 429, 500, 502, 503, 504}
CONNECT_SECONDS: Final = 15.0
SILENCE_SECONDS: Final = 30.0  # without a byte


def open_url(
    url: str, name: str
) -> tuple[Callable[[int, int], bytes], Callable[[], int | None], Callable[[], None]]:
    """Open a URL; name : for messages.

    returns : read(offset, length), fewer bytes only at the end; size, None while not known; close
    errors : UsageError for what cannot be opened, StoppedError when it breaks off or has changed
    """
    try:
        from fsspec.core import url_to_fs

        files, path = url_to_fs(url)
    except (ImportError, ValueError) as error:  # fsspec or a driver is missing; no such scheme
        said = f"{name}: cannot be read: {_line(error)}"
        raise UsageError(said, "pip install 'gstream[remote]', or download it") from error
    if "https" in files.protocol:
        file = _HttpFile(files, url, name)
        return file.read_at, lambda: file.size, lambda: None  # the session is fsspec's
    return _open_stored(files, path, name)


def _open_stored(
    files: Any, path: str, name: str
) -> tuple[Callable[[int, int], bytes], Callable[[], int | None], Callable[[], None]]:
    """A file of a store whose driver retries, and sends If-Match, on its own."""
    try:
        file = files.open(path, "rb", cache_type="none")
        size = file.seek(0, os.SEEK_END)
    except Exception as error:  # each driver has exceptions of its own
        said = f"{name}: cannot be read: {_line(error)}"
        raise UsageError(said, "check the address and your credentials") from error

    def read_at(offset: int, length: int) -> bytes:
        try:
            file.seek(offset)
            return bytes(file.read(length))
        except Exception as error:
            if type(error).__name__ == "FileExpired":  # s3fs: the entity tag is another one
                raise _changed(name) from error
            raise _broke_off(name, _line(error)) from error

    return read_at, lambda: size, file.close


def _line(error: BaseException) -> str:
    if isinstance(error, TimeoutError):
        return "no answer in time"
    said = " ".join(str(error).split()) or type(error).__name__
    absent = isinstance(error, FileNotFoundError)  # of which a driver may say the path alone
    return f"not found: {said}" if absent else said


def _changed(name: str) -> StoppedError:
    return StoppedError(f"{name}: is no longer the file that was opened", "run again to read it")


def _broke_off(name: str, said: str) -> StoppedError:
    return StoppedError(f"{name}: reading broke off: {said}", "run the same command again")


class _TransientError(Exception):
    """An answer that may be another one a second later."""


class _HttpFile:
    """One file of an HTTP server: ranges alone, all of them of the file that was first met.

    fsspec's own reading takes a whole file from a server without ranges, and does not look at the
    entity tag: of fsspec this uses the session with its loop, pool and settings.
    """

    def __init__(self, files: Any, url: str, name: str) -> None:
        self._files, self._url, self._name = files, url, name
        self._identity: tuple[str, str] | None = None  # entity tag or date, length
        self.size: int | None = None

    def read_at(self, offset: int, length: int) -> bytes:
        import aiohttp
        from fsspec.asyn import sync

        passing = (_TransientError, aiohttp.ClientConnectionError, aiohttp.ClientPayloadError)
        pauses = list(RETRY_SECONDS)
        while True:
            try:
                return bytes(sync(self._files.loop, self._get, offset, length))
            except (_TransientError, aiohttp.ClientError, TimeoutError, EOFError) as error:
                lasting = isinstance(error, aiohttp.ClientSSLError)
                lasting |= not isinstance(error, (*passing, TimeoutError, EOFError))
                if lasting or not pauses:
                    raise self._failure(_line(error)) from error
            time.sleep(pauses.pop(0))

    async def _get(self, offset: int, length: int) -> bytes:
        import aiohttp

        settings = dict(self._files.kwargs)
        headers = dict(settings.pop("headers", {}))
        headers["Range"] = f"bytes={offset}-{offset + length - 1}"
        headers["Accept-Encoding"] = "identity"  # ranges are of the file, not of its gzip
        patience = aiohttp.ClientTimeout(
            total=None, sock_connect=CONNECT_SECONDS, sock_read=SILENCE_SECONDS
        )
        session = await self._files.set_session()
        address = self._files.encode_url(self._url)
        async with session.get(address, headers=headers, timeout=patience, **settings) as answer:
            if answer.status == 416:
                return b""  # the range begins behind the end
            if answer.status != 206:
                raise self._refusal(answer.status, answer.reason)
            body = self._length_of(answer.headers, offset, length)
            return bytes(await answer.content.readexactly(body))

    def _refusal(self, status: int, reason: str | None) -> Exception:
        if status in TRANSIENT:
            return _TransientError(f"{status} {reason}")
        if status == 200:
            said = f"{self._name}: the server does not send ranges"
            return UsageError(said, "download the file and name the copy")
        return self._failure(f"{status} {reason}")

    def _length_of(self, headers: Any, offset: int, length: int) -> int:
        """Bytes that the answer has; checks that they are those asked for, of the same file."""
        stated = headers.get("Content-Range", "")
        match = re.fullmatch(r"bytes (\d+)-(\d+)/(\d+|\*)", stated)
        body = int(match[2]) - offset + 1 if match else 0
        if not match or int(match[1]) != offset or not 0 < body <= length:
            said = f"{self._name}: the server sends another range than was asked for: {stated!r}"
            raise UsageError(said, "download the file and name the copy")
        identity = (headers.get("ETag") or headers.get("Last-Modified") or "", match[3])
        if self._identity is None:
            self._identity = identity
            self.size = None if match[3] == "*" else int(match[3])
        if identity != self._identity:
            raise _changed(self._name)
        return body

    def _failure(self, said: str) -> UsageError | StoppedError:
        if self._identity is None:
            said = f"{self._name}: cannot be read: {said}"
            return UsageError(said, "check the address and the network")
        return _broke_off(self._name, said)
