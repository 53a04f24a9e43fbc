"""Files that the page offers: the text, a picture of the room, report, recording and ZIP of a run, rerun's viewer."""

import re
import shutil
import tempfile
import zipfile
from asyncio import get_running_loop
from importlib.util import find_spec
from io import BytesIO
from json import dumps
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tornado.web import HTTPError, RequestHandler

from taichi_plume.draw.access import REPORTS, Access
from taichi_plume.draw.completions import completions
from taichi_plume.draw.document import data_of
from taichi_plume.draw.workplace import Workplace
from taichi_plume.files.run_folder import files_in
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import open_regular
from taichi_plume.record.live import WEB_VIEWER, web_viewer_files

PIECE = 1 << 20  # bytes sent at once
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript",
    ".wasm": "application/wasm",
    ".png": "image/png",
    ".yaml": "text/yaml; charset=utf-8",
    ".zip": "application/zip",
    ".rrd": "application/octet-stream",
}
DPI = 150.0
_ace = find_spec("django_ace")  # found, never imported: only its static files are used
ACE = Path(_ace.origin).parent / "static/django_ace/ace" if _ace is not None and _ace.origin else None
_viewer: dict[str, bytes] = {}


class _Files(RequestHandler):
    """Base class of the handlers: they answer GET with one file."""

    def initialize(self, workplace: Workplace, access: Access) -> None:
        self.workplace, self.access = workplace, access

    async def offer(self, name: str, content: bytes | Path, inline: bool = False) -> None:
        """Send a file piece by piece; inline: shown in the browser, otherwise downloaded under its name."""
        self.set_header("Content-Type", TYPES[Path(name).suffix])
        self.set_header("Cache-Control", "no-store")
        if not inline:
            self.set_header("Content-Disposition", f"attachment; filename*=UTF-8''{quote(name, safe='')}")
        with BytesIO(content) if isinstance(content, bytes) else open_regular(content) as file:
            while piece := file.read(PIECE):
                self.write(piece)
                await self.flush()


class Share(_Files):
    """The text as YAML, the picture of its room, or the room for rerun's viewer."""

    async def get(self, ending: str) -> None:
        try:
            content = (
                self.workplace.text.encode("utf-8") if ending == "yaml" else drawn(self.workplace, ending)
            )
        except InputError as error:
            raise HTTPError(409, reason="the scenario has errors") from error
        await self.offer(f"{self.workplace.file.stem}.{ending}", content)


class OfRun(_Files):
    """Report, recording, or ZIP of all files of a run."""

    async def get(self, number: str, name: str) -> None:
        run = self.workplace.run_of(int(number))
        if run is None:
            raise HTTPError(404)
        if name == "run.zip":
            if run.alive:
                raise HTTPError(409, reason="the run has not ended")
            with tempfile.TemporaryDirectory() as folder:
                await self.offer(f"{run.folder.name}.zip", zipped(run.folder, Path(folder) / name))
            return
        file = run.folder / name
        if not file.is_file() or file.is_symlink():
            raise HTTPError(404)
        if name == "report.html":
            self.set_header("Content-Security-Policy", REPORTS)
        await self.offer(name, file, inline=True)


class Viewer(_Files):
    """Files of rerun's viewer for browsers, served from here, so that no other server and no other site is asked."""

    async def get(self, name: str) -> None:
        number = self.get_query_argument("run", "")
        if number:
            path = f"/runs/{int(number)}/recording.rrd" if number.isdecimal() else "/share/room.rrd"
            path = self.access.pass_to(path)
            recording = quote(f"http://{self.request.host}{path}", safe="")
            self.redirect(f"/viewer/?url={recording}&persist=false&hide_welcome_screen")
            return
        if not _viewer:
            _viewer.update(await get_running_loop().run_in_executor(None, web_viewer_files))
        await self.offer(name or "index.html", _viewer[name or "index.html"], inline=True)


class Editor(_Files):
    """Scripts of the editor Ace, from the package that has them; without the package the page has a plain area."""

    async def get(self, name: str) -> None:
        if ACE is None:
            raise HTTPError(404)
        await self.offer(name, ACE / name, inline=True)


class Completions(_Files):
    """Completions at the end of a text that is followed by another, as Ace takes them; the editor sends both."""

    async def post(self) -> None:
        before, _, after = self.request.body.decode("utf-8", "replace").partition(
            "\0"
        )  # no text has this character
        found = await get_running_loop().run_in_executor(None, completions, before + after, len(before))
        words = [{"value": each.word, "meta": each.unit, "docText": each.meaning} for each in found]
        self.set_header("Content-Type", "application/json")
        self.write(dumps(words))


def drawn(workplace: Workplace, ending: str) -> bytes:
    """Return the room as PNG, drawn as ``run --check`` does, or as a recording. Raises ScenarioError after errors.

    ending: "png" or "rrd".
    """
    from taichi_plume.assembly.preparation import load
    from taichi_plume.report.scene import all_shapes, checked_figure
    from taichi_plume.report.theme import png

    prepared = load(data_of(workplace.text), (), workplace.allow_outside, workplace.folder)
    if ending == "png":
        return png(checked_figure(prepared, DPI))
    from taichi_plume.record.room import room  # imports rerun

    return room(prepared.scenario, all_shapes(prepared))


def zipped(folder: Path, target: Path) -> Path:
    """Write a ZIP of the regular files of a run, without links, and return its path."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        entries = [entry for entry in files_in(folder) if not entry.is_symlink()]
        for file in sorted(file for entry in entries for file in (entry, *entry.rglob("*"))):
            if file.is_file() and not file.is_symlink():
                name = zipfile.ZipInfo.from_file(file, Path(folder.name) / file.relative_to(folder))
                name.compress_type = zipfile.ZIP_DEFLATED
                with open_regular(file) as content, archive.open(name, "w") as packed:
                    shutil.copyfileobj(content, packed, PIECE)
    return target


def patterns(workplace: Workplace, access: Access) -> list[Any]:
    """Return the addresses of these files, with their handlers."""
    about = {"workplace": workplace, "access": access}
    viewer = "|".join(re.escape(name) for name in ("", *WEB_VIEWER))
    return [
        (r"(?:/pass/[0-9a-f]{64})?/share/room\.(yaml|png|rrd)", Share, about),
        (r"(?:/pass/[0-9a-f]{64})?/runs/(\d{1,6})/(report\.html|recording\.rrd|run\.zip)", OfRun, about),
        (rf"/viewer/({viewer})", Viewer, about),
        (
            r"/editor/((?:ace|mode-yaml|ext-language_tools|theme-github_dark|theme-github_light_default)\.js)",
            Editor,
            about,
        ),
        (r"/editor/completions", Completions, about),
    ]
