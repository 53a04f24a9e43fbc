"""The page in a real browser, used by mouse and keyboard. TAICHI_PLUME_PICTURES=DIR keeps pictures of the steps."""

import time

import pytest
from browser import EDITOR, Browser, launched, program
from served import serving
from test_document import ROOT

from taichi_plume.scenario.loading import read_scenario

pytest.importorskip("bokeh", reason="the extra draw is not installed")
pytestmark = pytest.mark.slow

ROOM = (ROOT / "configs/casting_room.yaml").read_text()


@pytest.fixture(scope="module")
def chromium():
    program()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tools:
        browser = launched(tools)
        yield browser
        browser.close()


@pytest.fixture
def visit(chromium, tmp_path):
    """Function that serves a folder and opens pages of it."""
    stack = []

    def opened(*arguments):
        if not stack:
            manager = serving(tmp_path, *arguments)
            stack.append((manager, manager.__enter__()))
        return Browser(chromium.new_context().new_page(), stack[0][1])

    yield opened
    for manager, _ in stack:
        manager.__exit__(None, None, None)


def test_a_room_is_drawn_from_nothing_run_and_reported_in_two_minutes_of_clicks(visit, tmp_path):
    page = visit()
    began = time.monotonic()
    page.picture("1_empty")
    for kind, *way in (
        ("inlet", (0, 1), (0, 2)),
        ("outlet", (4, 1), (4, 2)),
        ("box", (1.0, 0.9), (1.4, 1.3)),
        ("box", (1.9, 1.8), (2.3, 2.4)),
    ):
        page.tool(kind)
        page.changed(lambda way=way: page.drag(*way))
    page.tool("source")
    page.changed(lambda: page.click(0.5, 1.5))
    page.tool("robots")
    page.changed(lambda: page.click(3.5, 1.0))
    page.changed(lambda: page.click(3.5, 2.0))
    page.tool("select")
    page.until(lambda: "cells" in page.text_of("size"))
    page.picture("2_drawn")
    page.press("Save")
    page.until((tmp_path / "room.yaml").exists)
    page.press("▶ Run")
    clicked = time.monotonic() - began
    page.until(lambda: "run 1" in page.text_of("progress"), 30)
    scenario = read_scenario(tmp_path / "room.yaml")
    assert [opening.kind for opening in scenario.openings] == ["inlet", "outlet"]
    assert [obstacle.kind for obstacle in scenario.obstacles] == ["box", "box"]
    assert [source.position for _, source in scenario.sources] == [(0.5, 1.5)]
    assert scenario.robots[0].start.positions == ((3.5, 1.0), (3.5, 2.0))
    gas = """() => {
      const models = [...Bokeh.documents[0]._all_models.values()]
      const source = models.find((model) => model.name == "gas")
      const image = source.data.image[0]
      return image == null ? 0 : [...image].filter((pixel) => pixel >>> 24).length
    }"""
    page.until(lambda: page.page.evaluate(gas) > 500 and "running" in page.text_of("progress"), 240)
    page.picture("3_live")
    page.until(
        lambda: any(
            word in page.text_of("progress") for word in ("completed", "source found", "ended early")
        ),
        300,
    )
    page.picture("4_ended")
    page.tab("Report")
    report = page.until(lambda: next((f for f in page.page.frames if f.url.endswith("report.html")), None))
    report.wait_for_selector("h1")
    assert report.locator("h1").inner_text() == "room"
    page.picture("5_report")
    page.tab("Recording")
    viewer = page.until(lambda: next((f for f in page.page.frames if "recording.rrd" in f.url), None), 60)
    viewer.wait_for_selector("canvas.visible", timeout=120_000)
    page.page.wait_for_timeout(5_000)
    page.picture("6_recording")
    assert page.errors == []
    assert page.elsewhere == []
    assert clicked < 120


def test_a_file_is_opened_changed_and_saved_with_its_comments(visit, tmp_path):
    (tmp_path / "casting_room.yaml").write_text(ROOM)
    page = visit("casting_room.yaml")
    page.picture("a_opened")
    page.click(2.75, 1.9)
    page.page.wait_for_timeout(800)
    page.picture("b_chosen")
    page.changed(lambda: page.drag((2.75, 1.9), (2.5, 1.4), held=600))
    page.page.keyboard.press("Control+s")
    file = tmp_path / "casting_room.yaml"
    page.until(lambda: "center: [2.5, 1.4]" in file.read_text())
    page.picture("c_saved")
    old, new = ROOM.splitlines(), file.read_text().splitlines()
    assert [line for a, line in zip(old, new, strict=True) if a != line] == [
        "  - {kind: box, center: [2.5, 1.4], size: [0.25, 0.35]}"
    ]
    page.changed(lambda: page.page.keyboard.press("Control+z"))
    assert page.yaml == ROOM
    page.changed(lambda: page.page.keyboard.press("Control+Shift+z"))
    page.changed(lambda: page.page.keyboard.press("Delete"))
    assert "2.5, 1.4" not in page.yaml
    page.tab("YAML")
    page.page.wait_for_selector(EDITOR)
    page.changed(lambda: page.write("center: [1.5, 2.1]", "center: [0.7, 1.45]"))
    page.until(lambda: "error" in page.text_of("size"))
    page.page.wait_for_selector(".ace_gutter-cell.ace_error")
    page.page.keyboard.press("Control+s")
    page.until(lambda: "center: [0.7, 1.45]" in file.read_text())
    with page.page.expect_popup():  # a scenario with errors has no picture; the page stays
        page.page.locator("a", has_text="picture").click()
    page.tab("Remarks")
    assert "source 1, position" in page.text_of("remarks")
    assert "is inside cylinder 1," in page.text_of("remarks")
    page.picture("d_mistake")
    assert page.errors == []
    assert page.elsewhere == []


def test_every_button_is_seen_in_a_narrow_window(visit):
    page = visit()
    page.page.set_viewport_size({"width": 1024, "height": 640})
    page.page.wait_for_timeout(500)
    assert page.page.evaluate("document.documentElement.scrollWidth") == 1024
    for button in (
        page.page.locator(".bk-btn").get_by_text(label).first for label in ("Undo", "Save", "Run")
    ):
        box = button.bounding_box()
        assert 0 <= box["x"] < box["x"] + box["width"] <= 1024
    page.page.locator(".bk-btn").get_by_text("▶ Run", exact=True).click(
        trial=True, timeout=5_000
    )  # nothing lies over it


def test_a_tab_in_the_background_shows_an_edit_once_it_is_seen_again(visit, tmp_path):
    (tmp_path / "s.yaml").write_text(ROOM)
    first, second = visit("s.yaml"), visit()
    turn = """(state) => {
      Object.defineProperty(document, "visibilityState", {value: state, configurable: true})
      document.dispatchEvent(new Event("visibilitychange"))
    }"""
    second.page.evaluate(turn, "hidden")
    before = second.yaml
    first.tool("source")
    first.changed(lambda: first.click(1.0, 0.5))
    second.page.wait_for_timeout(1000)
    assert second.yaml == before
    second.page.evaluate(turn, "visible")
    second.until(lambda: second.yaml == first.yaml, 30)
    first.page.close()
    second.page.reload()
    second.page.wait_for_selector(".bk-Figure")
    second.until(lambda: "[1, 0.5]" in second.yaml)
    assert not first.errors
    assert not second.errors


def test_a_foreign_page_can_neither_frame_nor_ask_the_page(visit, chromium, tmp_path):
    """A page of another site in the same browser, in which the user has opened the page before."""
    page = visit()
    host = page.served.host
    (tmp_path / "evil.html").write_text("<title>evil</title>")
    foreign = page.page.context.new_page()
    foreign.route(
        "http://evil.example/*",
        lambda route: route.fulfill(body="<title>evil</title>", content_type="text/html"),
    )
    foreign.goto("http://evil.example/")
    socket = f"""() => new Promise((done) => {{
      const socket = new WebSocket("ws://{host}/ws")
      socket.onopen = () => done("open"); socket.onerror = () => done("refused")
    }})"""
    assert foreign.evaluate(socket) == "refused"
    fetch = f"""() => fetch("http://{host}/share/room.yaml", {{credentials: "include"}}).then(
      (answer) => answer.text(), () => "refused")"""
    assert foreign.evaluate(fetch) == "refused"
    opaque = f"""() => fetch("http://{host}/share/room.yaml", {{mode: "no-cors", credentials: "include"}}).then(
      (answer) => answer.type, () => "refused")"""
    assert foreign.evaluate(opaque) in ("refused", "opaque")
    foreign.evaluate(f"""() => {{ document.body.innerHTML = '<iframe src="http://{host}/"></iframe>' }}""")
    foreign.wait_for_timeout(1500)
    assert all("bk-Figure" not in frame.content() for frame in foreign.frames if host in frame.url)


def test_an_open_page_says_so_when_its_server_is_killed_and_the_text_is_there_again(
    visit, tmp_path, chromium
):
    (tmp_path / "s.yaml").write_text(ROOM)
    page = visit("s.yaml")
    page.tool("source")
    page.changed(lambda: page.click(1.0, 0.5))
    mine = page.yaml
    page.served.process.kill()
    page.served.process.wait()
    page.page.wait_for_selector("[role=alert]")
    assert "does not answer" in page.page.locator("[role=alert]").inner_text()
    page.picture("x_killed")
    with serving(tmp_path, "s.yaml") as served:
        again = Browser(chromium.new_context().new_page(), served)
        again.picture("y_question")
        again.changed(lambda: again.press("Yes"))
        assert again.yaml == mine


def test_a_run_is_looked_at_in_time(visit, tmp_path):
    (tmp_path / "room.yaml").write_text(ROOM.replace("duration: ", "duration: 12 # "))
    page = visit("room.yaml")
    page.press("▶ Run")
    page.until(lambda: "completed" in page.text_of("progress"), 180)
    page.press("▶ play")
    page.until(lambda: 3 < page.text_of("time") < 11)
    page.picture("t_playing")
    page.press("❚❚ pause")
    page.page.wait_for_timeout(500)
    at = page.text_of("time")
    page.page.wait_for_timeout(1000)
    assert page.text_of("time") == at < 12
    page.changed(lambda: page.drag((2.75, 1.9), (3.2, 1.6)))
    page.page.wait_for_timeout(500)
    page.picture("t_edited")
    page.press("latest")
    page.page.wait_for_timeout(500)
    page.picture("t_latest")
    assert page.errors == []


def test_two_runs_are_compared(visit, tmp_path):
    (tmp_path / "room.yaml").write_text(ROOM.replace("duration: ", "duration: 6 # "))
    page = visit("room.yaml")
    for n in (1, 2):
        page.press("▶ Run")
        page.until(
            lambda n=n: all(word in page.text_of("progress") for word in (f"run {n}<", "completed")), 180
        )
        if n == 1:
            page.changed(lambda: page.drag((1.5, 2.1), (1.5, 2.3)))
    page.choose("other", "1")
    page.press("▶ play")
    page.until(lambda: 2 < page.text_of("time") < 5)
    page.press("❚❚ pause")
    page.until(lambda: "decades" in page.text_of("hint"))
    page.page.wait_for_timeout(500)
    page.picture("t_compared")
    assert page.errors == []


def test_keys_are_completed_and_undone_in_the_editor(visit, tmp_path):
    (tmp_path / "room.yaml").write_text(ROOM)
    page = visit("room.yaml")
    page.tab("YAML")
    page.page.wait_for_selector(EDITOR)
    page.changed(lambda: page.write("warm_up: 12 s", "warm_up: 12 s  # 𝒯 = 12 s, 𝓊 = 0.5 m/s 🌀🌀🌀\n"))
    page.changed(lambda: page.page.keyboard.type("stop"))
    page.page.locator(".ace_autocomplete", has_text="stop_early").wait_for()
    page.picture("e_completed")
    page.changed(lambda: page.page.keyboard.press("Enter"))
    page.until(lambda: "\nstop_early: \n" in page.yaml)
    page.changed(lambda: page.page.keyboard.press("Control+z"))
    page.until(lambda: page.page.locator(EDITOR).evaluate("it => it.env.editor.getValue()") == page.yaml)
    page.tab("Remarks")
    assert page.errors == []


def test_a_page_goes_on_once_its_server_answers_again(visit, tmp_path):
    """As after a laptop's sleep: the text that was typed meanwhile is there, too."""
    (tmp_path / "room.yaml").write_text(ROOM)
    page = visit("room.yaml")
    page.tab("YAML")
    page.page.wait_for_selector(EDITOR)
    page.page.evaluate("sockets.forEach((socket) => socket.close())")
    page.page.wait_for_selector("[role=alert]")
    page.write("seed: 2", "seed: 7")
    page.picture("x_lost")
    page.page.wait_for_selector("[role=alert]", state="detached", timeout=30_000)
    page.page.wait_for_function("window.Bokeh?.documents?.length", timeout=30_000)
    page.until(lambda: "seed: 7" in page.yaml)
    page.until(lambda: b"seed: 7" in page.served.get("/share/room.yaml")[2])


def test_the_room_is_seen_in_three_dimensions(visit, tmp_path):
    page = visit("arena_3d")
    page.tab("3-D")
    viewer = page.until(lambda: next((f for f in page.page.frames if "room.rrd" in f.url), None), 60)
    viewer.wait_for_selector("canvas.visible", timeout=120_000)
    page.page.wait_for_timeout(5_000)
    page.picture("s_solid")
    assert page.errors == []
    assert page.elsewhere == []


def test_hands_use_keys_the_right_button_and_a_rectangle(visit, tmp_path):
    (tmp_path / "s.yaml").write_text(ROOM)
    page = visit("s.yaml")
    mouse, keyboard = page.page.mouse, page.page.keyboard
    keyboard.down("Shift")
    page.drag((0.9, 0.2), (3.2, 2.6))
    keyboard.up("Shift")
    page.until(lambda: "3 objects" in page.text_of("hint"))
    page.picture("h_selected")
    page.changed(lambda: keyboard.press("Shift+ArrowRight"))
    assert "center: [2, 2.1]" in page.yaml
    assert "center: [3.25, 1.9]" in page.yaml
    page.changed(lambda: keyboard.press("Control+z"))
    assert page.yaml == ROOM
    mouse.click(*page.at(2.75, 1.9))
    page.page.wait_for_timeout(300)
    keyboard.press("Control+c")
    mouse.move(*page.at(1.0, 0.5))
    page.page.wait_for_timeout(100)
    page.changed(lambda: keyboard.press("Control+v"))
    assert "center: [1, 0.5]" in page.yaml
    mouse.click(*page.at(1.0, 0.5), button="right")
    item = page.page.locator(".bk-btn").get_by_text("Delete", exact=True).last
    item.wait_for(state="visible")
    page.picture("h_menu")
    page.changed(item.click)
    assert page.yaml == ROOM
    x, y = page.at(0.5, 0.3)
    mouse.move(x, y)
    mouse.down()
    for n in range(1, 11):
        mouse.move(x + 8 * n, y)
        page.page.wait_for_timeout(20)
    mouse.up()
    page.page.wait_for_timeout(500)
    assert page.at(0.5, 0.3)[0] - x == pytest.approx(80, abs=1), "the floor stays under the pointer"
    page.page.evaluate("addEventListener('keydown', (event) => { window.kept = event.defaultPrevented })")
    keyboard.down("Control")
    for _ in range(4):  # held: the browser's own dialog must not open
        keyboard.down("s")
        assert page.page.evaluate("kept"), "Ctrl-S is the page's alone"
    keyboard.up("s")
    keyboard.up("Control")
    keyboard.press("?")
    page.page.get_by_text("paste at the pointer").wait_for()
    assert page.errors == []
    assert page.elsewhere == []


def test_fingers_select_move_and_zoom(visit, chromium, tmp_path):
    (tmp_path / "s.yaml").write_text(ROOM)
    page = Browser(chromium.new_context(has_touch=True).new_page(), visit("s.yaml").served)
    fingers = page.page.context.new_cdp_session(page.page)

    def touch(kind, *points):
        found = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(points)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": found})
        page.page.wait_for_timeout(30)

    def slide(*ways):
        touch("touchStart", *(a for a, _ in ways))
        for n in range(1, 9):
            touch(
                "touchMove", *((a[0] + n / 8 * (b[0] - a[0]), a[1] + n / 8 * (b[1] - a[1])) for a, b in ways)
            )
        touch("touchEnd")
        page.page.wait_for_timeout(500)

    page.page.touchscreen.tap(*page.at(2.75, 1.9))
    page.until(lambda: page.text_of("sections") == "obstacles[2]")
    page.changed(lambda: slide((page.at(2.75, 1.9), page.at(2.5, 1.4))))
    assert "center: [2.5, 1.4]" in page.yaml
    floor = page.at(0.5, 0.5)
    slide((floor, (floor[0] + 80, floor[1])))
    assert page.at(0.5, 0.5)[0] - floor[0] == pytest.approx(80, abs=1)
    before = page.at(3, 1)[0] - page.at(1, 1)[0]
    (x, y), (x2, _) = page.at(1.5, 1.5), page.at(2.1, 1.5)
    slide(((x, y), (x - 60, y)), ((x2, y), (x2 + 60, y)))
    assert page.at(3, 1)[0] - page.at(1, 1)[0] > 1.2 * before


def test_a_form_is_filled_in_by_keyboard_and_ctrl_z_undoes_the_room_in_its_fields(visit, tmp_path):
    (tmp_path / "casting_room.yaml").write_text(ROOM)
    page = visit("casting_room.yaml")
    page.click(1.5, 2.1)
    fields = page.page.locator(".bk-input-container input:visible")
    page.until(lambda: "cylinder" in page.page.locator("select:visible").nth(1).input_value())
    values = [field.input_value() for field in fields.all()]
    radius = fields.nth(values.index("0.15"))
    radius.fill("-1")
    radius.press("Enter")
    page.until(lambda: radius.input_value() == "0.15")
    assert page.page.get_by_text("at least 1e-06 m").is_visible()
    assert page.yaml == ROOM
    page.picture("f_refused")
    radius.fill("25 cm")
    page.changed(lambda: radius.press("Enter"))
    assert page.yaml == ROOM.replace("radius: 0.15", "radius: 25 cm")
    assert radius.input_value() == "25", "the unit is beside it"
    radius.press("7")
    radius.press("Control+z")
    assert page.yaml == ROOM.replace("radius: 0.15", "radius: 25 cm"), "the browser undoes what was typed"
    radius.press("Tab")
    page.changed(lambda: page.page.keyboard.press("Control+z"))
    assert page.yaml == ROOM
    radius.fill("0.3")
    page.click(2.75, 1.9)
    page.until(lambda: page.text_of("sections") == "obstacles[2]")
    assert page.yaml == ROOM.replace("radius: 0.15", "radius: 0.3"), (
        "an entry is that of the object it was made for"
    )
    page.picture("g_box")
    assert page.errors == []
