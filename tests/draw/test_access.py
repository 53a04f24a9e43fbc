"""Attacks on the page: foreign hosts, pages and processes, and files outside the folder."""

import http.client
import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

pytest.importorskip("bokeh", reason="the extra draw is not installed")

from served import serving
from test_document import ROOT


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("folder")
    (folder / "room.yaml").write_text((ROOT / "configs/casting_room.yaml").read_text())
    (folder.parent / "secret.yaml").write_text("a: 1")
    with serving(folder, "room.yaml") as served:
        yield served


def test_only_the_loopback_interface_listens(page):
    addresses = [c.laddr for c in psutil.Process(page.process.pid).net_connections() if c.status == "LISTEN"]
    assert addresses == [("127.0.0.1", page.port)]
    own = [address for named in psutil.net_if_addrs().values() for address in named]
    others = {a.address for a in own if a.family == socket.AF_INET and not a.address.startswith("127.")}
    for other in others:
        with pytest.raises(OSError, match=r"refused|timed out|unreachable"):
            socket.create_connection((other, page.port), timeout=2).close()


def test_the_token_of_the_address_becomes_a_cookie_that_scripts_and_foreign_pages_lack(page):
    status, headers, _ = page.get(f"/?token={page.token}", cookie=False)
    assert (status, headers["Location"]) == (303, "/")
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    status, headers, body = page.get("/")
    assert status == 200
    assert page.token.encode() not in body, "scripts cannot read the token"
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert "frame-ancestors 'self'" in headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    "path",
    [
        "/", "/?token=", "/?token=x", "/?bokeh-session-id=x", "/autoload.js", "/metadata", "/static/js/bokeh.min.js",
        "/share/room.yaml", "/share/room.png", "/viewer/", "/runs/1/report.html", "/pass/00/runs/1/recording.rrd",
        "/favicon.ico", "/pass/é", "/pass/é/runs/1/recording.rrd", "/pass/%C3%A9", "/pass", "//é",
    ],
)  # fmt: skip
def test_without_the_token_nothing_is_answered(page, path):
    status, _, body = page.get(path, cookie=False)
    assert status == 403
    assert b"casting" not in body


def test_another_token_is_refused(page):
    other = page.token[:-1] + ("y" if page.token[-1] == "x" else "x")
    assert page.get(f"/?token={other}", cookie=False)[0] == 403
    assert page.get(f"/?token={page.token}&token=x", cookie=False)[0] == 403
    assert page.get("/", cookie=False, Cookie=f"taichi_plume_draw_{page.port}=x")[0] == 403
    assert page.get("/", cookie=False, Cookie=f"taichi_plume_draw_1={page.token}")[0] == 403


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", "127.0.0.1:1", "", None])
def test_a_foreign_host_name_is_refused(page, host):
    """DNS rebinding: a foreign page whose name was made to point to this machine."""
    assert page.get("/", Host=host)[0] in (400, 403)
    assert page.upgrade(Host=host) in (400, 403)


def test_a_page_is_served_under_localhost_too(page):
    assert page.get("/", Host=f"localhost:{page.port}")[0] == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1", "file://"]
)
def test_requests_of_foreign_pages_are_refused(page, origin):
    assert page.get("/", Origin=origin)[0] == 403
    assert page.get("/share/room.yaml", Origin=origin)[0] == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_links_of_foreign_pages_bring_nothing(page, site):
    assert page.get("/", Sec_Fetch_Site=site)[0] == 403
    assert page.get("/share/room.yaml", Sec_Fetch_Site=site)[0] == 403


def test_the_websocket_is_for_the_page_alone(page):
    assert page.upgrade() == 101
    for origin in ("http://evil.example", "null", f"http://localhost:{page.port}", None):
        assert page.upgrade(Origin=origin) == 403, origin
    assert page.upgrade(Cookie=None) == 403
    assert page.upgrade(Cookie=f"taichi_plume_draw_{page.port}=x") == 403


@pytest.mark.parametrize(
    "path",
    [
        "/runs/1/../../secret.yaml", "/runs/1/..%2f..%2fsecret.yaml", "/share/../secret.yaml", "/share/secret.yaml",
        "/static/../../secret.yaml", "/static/..%2f..%2f..%2fetc%2fpasswd", "/viewer/../secret.yaml",
        "/runs/999999/report.html", "/runs/1/result.json", "//etc/passwd",
    ],
)  # fmt: skip
def test_no_address_leads_to_other_files(page, path):
    status, _, body = page.get(path)
    assert status in (400, 403, 404)
    assert b"root:" not in body
    assert b"a: 1" not in body


def test_other_methods_are_refused(page):
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=30)
        cookie = f"taichi_plume_draw_{page.port}={page.token}"
        connection.request(method, "/share/room.yaml", headers={"Cookie": cookie})
        assert connection.getresponse().status == 405, method


@pytest.mark.parametrize(
    ("body", "word"),
    [("stop\0\nduration: 3 s", "stop_early: "), ("# 🌀🌀\n\0name: a", "domain: "), ("", "name: ")],
)
def test_completions_are_for_the_page_alone(page, body, word):
    """The text before the word's end, and behind a character that no text has, the text after it."""
    statuses = []
    for cookie in ({}, {"Cookie": f"taichi_plume_draw_{page.port}={page.token}"}):
        connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=30)
        connection.request("POST", "/editor/completions", body.encode(), cookie)
        answer = connection.getresponse()
        statuses.append(answer.status)
    assert statuses == [403, 200]
    assert word in [each["value"] for each in json.loads(answer.read())]


def test_the_text_and_its_picture_are_shared(page):
    status, headers, body = page.get("/share/room.yaml")
    assert (status, body) == (200, (ROOT / "configs/casting_room.yaml").read_bytes())
    assert "attachment" in headers["Content-Disposition"]
    assert page.get("/share/room.png")[2].startswith(b"\x89PNG")


def test_reports_of_others_run_no_scripts(tmp_path):
    """A folder in `runs` may come from anywhere; its report is shown within the page."""
    folder = tmp_path / "runs" / "foreign-1"
    folder.mkdir(parents=True)
    for name in ("result.json", "scenario.yaml"):
        (folder / name).write_text("{}")
    (folder / "report.html").write_text("<script>parent.document.title = 'mine'</script>")
    (tmp_path / "runs" / "link").symlink_to(tmp_path)
    with serving(tmp_path) as served:
        status, headers, _ = served.get("/runs/1/report.html")
        assert status == 200
        policy = [part.strip() for part in headers["Content-Security-Policy"].split(";")]
        assert "default-src data:" in policy, "no script, as no script-src is given"
        assert not [part for part in policy if part.startswith("script-src")]
        assert "sandbox allow-popups" in policy, "neither scripts nor the page's origin"
        assert served.get("/runs/2/report.html")[0] == 404


def command(folder: Path, *arguments: str):
    line = [sys.executable, "-m", "taichi_plume.draw", "--no-browser", *arguments]
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.slow
def test_a_scenario_outside_the_folder_is_opened_if_allowed_alone(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "s.yaml").write_text("duration: 1")
    (inner / "link.yaml").symlink_to(tmp_path / "s.yaml")
    for name in ("../s.yaml", str(tmp_path / "s.yaml"), "link.yaml"):
        done = command(inner, name)
        assert done.returncode == 2
        assert "--allow-outside" in done.stderr
    with serving(inner, "../s.yaml", "--allow-outside") as served:
        assert served.get("/share/room.yaml")[2] == b"duration: 1"


@pytest.mark.slow
def test_a_port_in_use_and_another_file_are_refused_in_one_line(tmp_path, page):
    done = command(tmp_path, "--port", str(page.port))
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    (tmp_path / "notes.txt").write_text("mine")
    done = command(tmp_path, "notes.txt")
    assert done.returncode == 2


@pytest.mark.slow
def test_a_page_without_changes_ends_without_a_word(tmp_path):
    with serving(tmp_path) as served:
        served.process.send_signal(signal.SIGTERM)
        assert served.process.wait(30) == 0
        assert served.process.stderr.read() == ""
    assert list(tmp_path.iterdir()) == []


def test_nothing_that_is_asked_for_is_printed(tmp_path):
    """Neither the token, which a mistyped address holds, nor control characters, nor a traceback."""
    with serving(tmp_path) as served:
        token = f"?token={served.token}"
        for path in (
            "/nowhere",
            "/pass/é",
            "/runs/9/report.html",
            "/share/room.png",
            "/static/js/x",
            "/\x1b[2J",
        ):
            for cookie in (True, False):
                assert served.get(f"{path}{token}", cookie=cookie)[0] in (400, 403, 404, 409), path
            assert served.get(path, cookie=False)[0] in (400, 403), path
        served.process.send_signal(signal.SIGTERM)
        assert served.process.wait(30) == 0
        assert served.process.stderr.read() == ""


def test_an_error_of_the_server_is_a_line_without_the_token(capsys):
    import logging

    from taichi_plume.draw.server import Log

    log = Log(debug=False)
    log.take_over()
    try:
        raise ValueError("odd\nvalue")
    except ValueError:
        logging.getLogger("tornado.application").exception(
            "GET /?token=abc (127.0.0.1)\nHTTPServerRequest(...)"
        )
    finally:
        log.take_over(end=True)
    assert capsys.readouterr().err == "GET /?... (127.0.0.1): ValueError: odd\\nvalue\n"


def test_without_the_extra_the_command_says_so(tmp_path):
    code = "import sys; sys.modules['bokeh'] = None\nimport importlib.util as u; f = u.find_spec\n"
    code += "u.find_spec = lambda name, *a: None if name == 'bokeh' else f(name, *a)\n"
    code += "from taichi_plume.cli.draw import main; sys.exit(main(['--no-browser']))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.strip() == "needs bokeh: pip install 'taichi_plume[draw]'"
