"""The server of the page: on the loopback interface alone, behind `access.Gatekeeper`."""

import asyncio
import secrets
import socket
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.netutil import bind_sockets

from taichi_plume.draw.access import Access, Gatekeeper, protection
from taichi_plume.draw.downloads import patterns
from taichi_plume.draw.page import Page
from taichi_plume.draw.workplace import Workplace
from taichi_plume.guard.input_error import InputError
from taichi_plume.record.live import LOOPBACK

TOKEN_BYTES = 24
PERIOD = 250  # ms between looks at the runs, and at whether the text has to be checked
LARGEST_MESSAGE = 8 << 20  # bytes, from a page: more than a scenario may have


class Service:
    """The page of a workplace at an address of this machine. port: 0 takes a free one. Raises InputError."""

    def __init__(self, workplace: Workplace, port: int = 0):
        self.workplace = workplace
        try:
            sockets = bind_sockets(port, LOOPBACK, socket.AF_INET)
        except OSError as error:
            raise InputError(f"port {port}: cannot be used: {error.strerror or error}") from None
        self.port = sockets[0].getsockname()[1]
        self.access = Access(self.port, secrets.token_urlsafe(TOKEN_BYTES))
        application = Application(FunctionHandler(self._open))
        tornado = BokehTornado(
            {"/": application},
            extra_websocket_origins=sorted(self.access.hosts),
            extra_patterns=patterns(workplace, self.access),
            include_headers=[], include_cookies=[],  # otherwise the page would contain them
            secret_key=secrets.token_bytes(32), sign_sessions=True,
            websocket_max_message_size_bytes=LARGEST_MESSAGE,
            transforms=[protection(self.access)],
        )  # fmt: skip
        server = HTTPServer(Gatekeeper(tornado, self.access))  # type: ignore[arg-type]
        server.add_sockets(sockets)
        self.loop = IOLoop.current()
        self.server = BaseServer(self.loop, tornado, server)
        self.pool = ThreadPoolExecutor(1)
        self._checking = False
        self.ticks = PeriodicCallback(self._tick, PERIOD)

    @property
    def address(self) -> str:
        """Address of the page with its token."""
        return f"http://{LOOPBACK}:{self.port}/?token={self.access.token}"

    def start(self) -> None:
        """Serve pages, once the loop runs."""
        self.server.start()
        self.ticks.start()

    def stop(self) -> None:
        """Serve no more pages. Runs go on."""
        self.ticks.stop()
        with suppress(AssertionError):  # Bokeh's, if it has been stopped already
            self.server.stop()
        self.pool.shutdown(wait=False, cancel_futures=True)
        self.workplace.runs.close()

    def _open(self, document) -> None:
        document.title = f"{self.workplace.file.name} - taichi_plume draw"
        Page(document, self.workplace)

    async def _tick(self) -> None:
        work = self.workplace
        work.runs.poll()
        if self._checking or work.checked == work.text:
            return
        self._checking = True
        try:
            work.found(*await asyncio.get_running_loop().run_in_executor(self.pool, work.check))
        finally:
            self._checking = False
