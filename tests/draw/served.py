"""The command `draw` in a process of its own, and plain HTTP and WebSocket clients of it."""

import http.client
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

PATIENCE = 120  # s


class Served:
    """A served page. url: with its token; process: of the command."""

    def __init__(self, process: subprocess.Popen, url: str):
        self.process, self.url = process, url
        parts = urlsplit(url)
        self.port, self.token = parts.port, parse_qs(parts.query)["token"][0]
        self.host = f"127.0.0.1:{self.port}"

    def get(self, path="/", cookie=True, **headers):
        """Status, headers and body of an answer. Headers: those of a browser, replaced or (None) left out."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        sent = {"Host": self.host} | (
            {"Cookie": f"taichi_plume_draw_{self.port}={self.token}"} if cookie else {}
        )
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection._validate_path = lambda _: None  # attacks have characters that no browser sends
        connection._encode_request = lambda line: line.encode("utf-8")
        connection.putrequest("GET", path, skip_host=True)
        for name, value in sent.items():
            if value is not None:
                connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()

    def upgrade(self, **headers):
        """Status of the answer to a request for the page's WebSocket, from the page itself unless headers differ."""
        wanted = {
            "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==", "Origin": f"http://{self.host}",
            "Sec-WebSocket-Protocol": f"bokeh, {self.session()}",
        }  # fmt: skip
        return self.get("/ws", **{**wanted, **headers})[0]

    def session(self) -> str:
        """Bokeh's token of a new session, from the page."""
        page = self.get("/")[2].decode()
        found = re.search(r'"token":"([^"]+)"', page)
        assert found
        return found[1]


@contextmanager
def serving(folder: Path, *arguments: str, stdin=subprocess.DEVNULL):
    command = [sys.executable, "-m", "taichi_plume.draw", "--no-browser", *arguments]
    # a group of its own, as the command's runs have
    process = subprocess.Popen(
        command, cwd=folder, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    try:
        line = process.stdout.readline()
        found = re.search(r"http://\S+", line)
        assert found, f"{line} {process.stderr.read() if process.poll() is not None else ''}"
        yield Served(process, found[0])
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        try:
            process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
