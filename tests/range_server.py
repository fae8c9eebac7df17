"""An HTTP server of byte ranges for tests: it counts, and misbehaves as it is told."""

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

HANGS_UP, IS_SILENT, BREAKS_OFF = 0, 1, 2


@dataclass
class Site:
    """One file behind one URL, what was asked of it, and how it answers."""

    data: bytes
    tag: str | None = '"first"'
    url: str = ""
    ranges: bool = True  # False: every answer is the whole file
    failures: list[int] = field(default_factory=list)  # of the next answers: statuses, or these:
    location: str | None = None  # that answers with a status send the reader to
    requests: list[tuple[str, str]] = field(default_factory=list)  # method, Range header
    sent: int = 0  # bytes of bodies
    awake: threading.Event = field(default_factory=threading.Event)  # ends every silence

    def handler(self) -> type[BaseHTTPRequestHandler]:
        site = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True  # head and body are two writes: 40 ms each otherwise

            def do_GET(self) -> None:
                asked = self.headers.get("Range", "")
                site.requests.append((self.command, asked))
                if site.failures:
                    self.fail(site.failures.pop(0))
                elif site.ranges and asked:
                    self.send_range(*map(int, re.fullmatch(r"bytes=(\d+)-(\d+)", asked).groups()))
                else:
                    self.send(200, site.data)

            def do_HEAD(self) -> None:
                self.do_GET()

            def fail(self, status: int) -> None:
                if status == IS_SILENT:
                    site.awake.wait()
                elif status == BREAKS_OFF:
                    first = int(re.search(r"\d+", self.headers["Range"])[0])
                    said = f"bytes {first}-{first + 99}/{len(site.data)}"
                    self.send(206, b"half", {"Content-Range": said, "Content-Length": "100"})
                elif status != HANGS_UP:
                    self.send(status, b"no", {"Location": site.location})
                self.close_connection = True

            def send_range(self, first: int, last: int) -> None:
                size = len(site.data)
                body = site.data[first : last + 1]
                if not body:
                    self.send(416, b"", {"Content-Range": f"bytes */{size}"})
                    return
                said = f"bytes {first}-{first + len(body) - 1}/{size}"
                self.send(206, body, {"Content-Range": said})

            def send(self, status: int, body: bytes, headers: dict[str, str] | None = None) -> None:
                self.send_response(status)
                fields = {"Content-Length": str(len(body)), "ETag": site.tag, **(headers or {})}
                for name, value in fields.items():
                    if value is not None:
                        self.send_header(name, value)
                self.end_headers()
                try:
                    self.wfile.write(body)
                    site.sent += len(body)
                except ConnectionError:
                    self.close_connection = True  # the reader wants no whole file

            def log_message(self, *_: object) -> None:
                pass

        return Handler


@contextmanager
def serving(data: bytes, **how: object) -> Iterator[Site]:
    """Serve `data` at site.url from a thread until the block ends."""
    site = Site(data, **how)
    server = ThreadingHTTPServer(("127.0.0.1", 0), site.handler())
    server.daemon_threads = True
    site.url = f"http://127.0.0.1:{server.server_port}/scene.gsb"
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield site
    finally:
        site.awake.set()
        server.shutdown()
        server.server_close()
        thread.join()
