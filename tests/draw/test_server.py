"""The server of the page: pages of closed tabs are forgotten."""

import asyncio
import gc
import weakref

import pytest

pytest.importorskip("bokeh", reason="the extra draw is not installed")

from test_document import ROOT
from tornado.httpclient import AsyncHTTPClient

from taichi_plume.draw import server
from taichi_plume.draw.page import Page
from taichi_plume.draw.workplace import Workplace

PATIENCE = 60  # s


async def visited(place: Workplace, count: int) -> None:
    """Fetch the page as often as that, and wait until the server has forgotten all of it."""
    service = server.Service(place)
    service.start()
    try:
        headers = {"Cookie": f"{service.access.cookie}={service.access.token}"}
        for _ in range(count):
            await AsyncHTTPClient().fetch(f"http://127.0.0.1:{service.port}/", headers=headers)
        async with asyncio.timeout(PATIENCE):
            while place.pages:
                place._notify()
                await asyncio.sleep(0.1)
        await asyncio.sleep(0.1)
    finally:
        service.stop()


def test_pages_of_closed_tabs_are_freed(tmp_path, monkeypatch):
    pages = []
    # on a busy machine, the first page goes before the second one comes
    monkeypatch.setattr(server, "UNUSED", 2000)
    monkeypatch.setattr(server, "Page", lambda *given: pages.append(weakref.ref(Page(*given))))
    (tmp_path / "s.yaml").write_text((ROOT / "configs/casting_room.yaml").read_text())
    place = Workplace(tmp_path, tmp_path / "s.yaml")
    asyncio.run(visited(place, 2))
    gc.collect()
    assert [page() for page in pages] == [None, None]
    assert place.pages == []


def test_an_example_is_drawn_as_a_copy(tmp_path, monkeypatch, capsys):
    from taichi_plume.cli import draw

    drawn = []

    async def serve(place, *_):
        drawn.append(place.file)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(draw, "_serve", serve)
    assert draw.main(["casting_room"]) == 0
    file = tmp_path / "casting_room.yaml"
    assert drawn == [file]
    assert file.read_bytes() == (ROOT / "configs/casting_room.yaml").read_bytes()
    file.write_text("# mine\n")
    assert draw.main(["casting_room"]) == 0, "an earlier copy is drawn as it is"
    assert file.read_text() == "# mine\n"
    for name, words in (("studies/wind_speeds", "is a study"), ("casting_rom", "casting_room")):
        assert draw.main([name]) == 2
        assert words in capsys.readouterr().err
    assert len(drawn) == 2
