"""The server of the page: on the loopback interface alone, for requests that `access.Access` lets in."""

import asyncio
import gc
import logging
import re
import secrets
import socket
import sys
import traceback
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.netutil import bind_sockets

from taichi_plume.draw import forms
from taichi_plume.draw.access import Access, Answer, Protection
from taichi_plume.draw.downloads import patterns
from taichi_plume.draw.page import Page
from taichi_plume.draw.workplace import Workplace
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say
from taichi_plume.record.live import LOOPBACK

TOKEN_BYTES = 24
UNUSED = 15_000  # ms until the page of a closed tab is forgotten
PERIOD = 400  # ms between looks at the runs
CHECKS = 20  # ms between looks at whether the text has to be checked
SWITCH = 1e-3  # s in which a check in another thread lets the pages go on
LARGEST_MESSAGE = 64 << 20  # bytes, from a page: more than a file that a user brings, in base64


class Guarded(BokehTornado):
    """Bokeh's application: requests that `Access` refuses do not reach the handlers."""

    def __init__(self, applications: dict[str, Application], access: Access, **settings: Any):
        self.access = access
        protection = partial(Protection, access)
        # no request is logged: its URL may hold the token
        super().__init__(applications, transforms=[protection], log_function=lambda _: None, **settings)

    def find_handler(self, request: Any, **kwargs: Any) -> Any:
        if self.access.refusal(request) or self.access.enters(request):
            return self.get_handler_delegate(request, Answer, {"access": self.access})
        return super().find_handler(request, **kwargs)


LOGGERS = tuple(map(logging.getLogger, ("tornado", "bokeh", "asyncio")))


class Log(logging.Handler):
    """Warnings and errors of tornado, Bokeh and asyncio on the terminal, a line each.

    Queries of URLs are left out, as they hold the token.
    debug: print tracebacks as well.
    """

    def __init__(self, debug: bool):
        super().__init__(logging.WARNING)
        self.debug = debug

    def emit(self, record: logging.LogRecord) -> None:
        lines = record.getMessage().splitlines()[:1]
        error = record.exc_info[1] if record.exc_info else None
        if error is not None:
            lines[0] += f": {type(error).__name__}: {error}"
            lines += "".join(traceback.format_exception(error)).splitlines() if self.debug else []
        say(*(re.sub(r"\?\S*", "?...", line) for line in lines), error=True)

    def take_over(self, end: bool = False) -> None:
        """Take the place of Python's own output of these records, or end this."""
        for logger in LOGGERS:
            (logger.removeHandler if end else logger.addHandler)(self)
            logger.propagate = end


class Service:
    """The page of a workplace at an address of this machine. Raises InputError.

    port: 0 takes a free one; debug: print tracebacks of unexpected errors.
    """

    def __init__(self, workplace: Workplace, port: int = 0, debug: bool = False):
        self.workplace, self.log = workplace, Log(debug)
        try:
            sockets = bind_sockets(port, LOOPBACK, socket.AF_INET)
        except OSError as error:
            raise InputError(f"port {port}: cannot be used: {error.strerror or error}") from None
        self.port = sockets[0].getsockname()[1]
        self.access = Access(self.port, secrets.token_urlsafe(TOKEN_BYTES))
        tornado = Guarded(
            {"/": Application(FunctionHandler(self._open))},
            self.access,
            extra_websocket_origins=sorted(self.access.hosts),
            extra_patterns=patterns(workplace, self.access),
            include_headers=[], include_cookies=[],  # otherwise the page would contain them
            secret_key=secrets.token_bytes(32), sign_sessions=True,
            websocket_max_message_size_bytes=LARGEST_MESSAGE,
            unused_session_lifetime_milliseconds=UNUSED, check_unused_sessions_milliseconds=UNUSED // 5,
        )  # fmt: skip
        server = HTTPServer(tornado)  # type: ignore[arg-type]
        server.add_sockets(sockets)
        self.loop = IOLoop.current()
        self.server = BaseServer(self.loop, tornado, server)
        self.pool = ThreadPoolExecutor(1)
        self._checking = False
        self.ticks = PeriodicCallback(self._tick, PERIOD), PeriodicCallback(self._check, CHECKS)

    @property
    def address(self) -> str:
        """Address of the page with its token."""
        return f"http://{LOOPBACK}:{self.port}/?token={self.access.token}"

    def start(self) -> None:
        """Serve pages, once the loop runs."""
        self.log.take_over()
        gc.collect()
        sys.setswitchinterval(SWITCH)
        gc.freeze()  # Bokeh collects garbage for each page that it forgets, which would search all modules
        self.pool.submit(forms.prepare)
        self.server.start()
        for tick in self.ticks:
            tick.start()

    def stop(self) -> None:
        """Serve no more pages. Runs go on."""
        for tick in self.ticks:
            tick.stop()
        with suppress(AssertionError):  # Bokeh's, if it has been stopped already
            self.server.stop()
        self.pool.shutdown(wait=False, cancel_futures=True)
        for run in self.workplace.runs:
            run.close()
        self.log.take_over(end=True)

    def _open(self, document) -> None:
        Page(document, self.workplace)

    def _tick(self) -> None:
        self.workplace.watch()
        self.workplace.retry_draft()

    async def _check(self) -> None:
        work = self.workplace
        if self._checking or work.checked == work.text:
            return
        self._checking = True
        try:
            work.found(*await asyncio.get_running_loop().run_in_executor(self.pool, work.check))
        finally:
            self._checking = False
