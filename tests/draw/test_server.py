"""The server of the page: pages of closed tabs are forgotten."""

import asyncio
import gc
import weakref

import pytest

pytest.importorskip("bokeh", reason="the extra draw is not installed")

from test_document import ROOT
from tornado.httpclient import AsyncHTTPClient

from taichi_plume.draw import server
from taichi_plume.draw.workplace import Workplace

PATIENCE = 60  # s


async def visited(place: Workplace, count: int) -> list[weakref.ref]:
    """Fetch the page as often as that, and wait until the server has forgotten all of it; return the pages."""
    service = server.Service(place)
    service.start()
    try:
        headers = {"Cookie": f"{service.access.cookie}={service.access.token}"}
        for _ in range(count):
            await AsyncHTTPClient().fetch(f"http://127.0.0.1:{service.port}/", headers=headers)
        assert len(place.listeners) == len(place.watchers) == count
        pages = [weakref.ref(listener.__self__) for listener in place.listeners]
        async with asyncio.timeout(PATIENCE):
            while place.listeners:
                place._notify()
                await asyncio.sleep(0.1)
        await asyncio.sleep(0.1)
        return pages
    finally:
        service.stop()


def test_pages_of_closed_tabs_are_freed(tmp_path, monkeypatch):
    monkeypatch.setattr(server, "UNUSED", 2000)
    (tmp_path / "s.yaml").write_text((ROOT / "configs/casting_room.yaml").read_text())
    place = Workplace(tmp_path, tmp_path / "s.yaml")
    pages = asyncio.run(visited(place, 2))
    gc.collect()
    assert [page() for page in pages] == [None, None]
    assert (place.listeners, place.watchers, place.queue) == ([], [], [])
