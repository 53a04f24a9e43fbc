"""The thirty tasks of `tasks.md` in a real browser, by mouse and keyboard, with a picture of each."""

import re
from pathlib import Path

import pytest
import yaml
from browser import EDITOR, Browser, launched, program
from served import serving

from taichi_plume.scenario.loading import read_scenario

pytest.importorskip("bokeh", reason="the extra draw is not installed")
pytestmark = pytest.mark.slow

TASKS = re.findall(
    r"^(\d+)\. (.+(?:\n   .+)*)", Path(__file__).with_name("tasks.md").read_text(), re.MULTILINE
)


class Hour:
    """A teacher at the page: data of the text, links and fields that are seen."""

    def __init__(self, page: Browser):
        self.page, self.tools, self.done = page, page.page, 0

    @property
    def data(self):
        return yaml.safe_load(self.page.yaml)

    def finish(self, task: int):
        """Note that a task is done, and take its picture."""
        assert task == self.done + 1
        self.done = task
        self.tools.wait_for_timeout(300)
        self.page.picture(f"{task:02}")

    def line(self, name: str):
        """Line of the form for the key of a name."""
        label = self.tools.locator(".key").filter(has_text=re.compile(rf"^\s*{name}\b"))
        return self.tools.locator(".key-line:visible").filter(has=label).first

    def field(self, name: str):
        """Field of the form for the key of a name."""
        return self.line(name).locator("input:visible, select:visible").first

    def keys(self, *names: str):
        for name in names:
            self.page.changed(lambda name=name: self.tools.keyboard.press(name))

    def menu(self, entry: str):
        """Choose an entry of the menu of files."""
        self.page.press("File")
        self.tools.get_by_text(entry, exact=True).click()
        self.tools.locator(".ask:visible").wait_for()


@pytest.fixture
def hour(tmp_path):
    program()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tools, serving(tmp_path) as served:
        yield Hour(Browser(launched(tools).new_context().new_page(), served))


def test_a_teacher_does_thirty_tasks(hour, tmp_path):
    page, tools, mouse = hour.page, hour.tools, hour.tools.mouse
    for word in ("inlet", "outlet", "source", "robots"):
        page.until(lambda word=word: word in page.text_of("size"))
    first = page.yaml
    hour.finish(1)
    page.tool("inlet")
    page.changed(lambda: page.drag((0, 1), (0, 2)))
    assert hour.data["wind"]["openings"][0] == {
        "kind": "inlet",
        "face": "x-",
        "center": 1.5,
        "size": "1 m",
    } | {key: value for key, value in hour.data["wind"]["openings"][0].items() if key not in ("face", "kind")}
    hour.finish(2)
    page.tool("outlet")
    page.changed(lambda: page.drag((3.7, 1.0), (3.7, 2.0)))
    assert hour.data["wind"]["openings"][1]["face"] == "x+"
    hour.finish(3)
    page.tool("box")
    mouse.move(*page.at(1.5, 0.5))
    mouse.down()
    for x, y in ((1.6, 0.7), (1.8, 0.8), (1.9, 0.9)):
        mouse.move(*page.at(x, y))
        tools.wait_for_timeout(100)
    page.picture("04_size")
    page.changed(mouse.up)
    assert hour.data["obstacles"][0]["size"] == [0.4, 0.4]
    hour.finish(4)
    page.tool("cylinder")
    page.changed(lambda: page.drag((1.71, 2.0), (1.86, 2.0)))
    page.tool("select")
    hour.finish(5)
    tools.locator("a[data-act='draw:source']").click()
    page.changed(lambda: page.click(0.5, 1.5))
    hour.finish(6)
    page.tool("robots")
    page.changed(lambda: page.click(3.5, 1.0))
    page.changed(lambda: page.click(3.5, 2.0))
    page.tool("select")
    page.until(lambda: "cells" in page.text_of("size"))
    hour.finish(7)
    hour.menu("Save as …")
    tools.locator(".ask:visible input:visible").fill("lesson.yaml")
    tools.locator(".ask:visible .bk-btn").get_by_text("Save", exact=True).click()
    page.until((tmp_path / "lesson.yaml").exists)
    hour.finish(8)
    page.click(1.6, 0.6)
    tools.wait_for_timeout(400)
    page.changed(lambda: page.drag((1.9, 0.9), (2.1, 1.1)))
    assert hour.data["obstacles"][0]["size"] == [0.6, 0.6]
    hour.finish(9)
    page.changed(lambda: page.press("⟲ 15°"))
    assert hour.data["obstacles"][0]["yaw_deg"] == 15
    hour.finish(10)
    center = hour.data["obstacles"][0]["center"]
    hour.keys("ArrowRight", "ArrowUp")
    assert hour.data["obstacles"][0]["center"] == pytest.approx([center[0] + 0.05, center[1] + 0.05])
    hour.finish(11)
    before = page.yaml
    tools.keyboard.down("Shift")
    page.click(*hour.data["obstacles"][1]["center"])
    tools.keyboard.up("Shift")
    tools.wait_for_timeout(400)
    x, y = hour.data["obstacles"][0]["center"]
    page.changed(lambda: page.drag((x, y), (x + 0.5, y)))
    moved = hour.data["obstacles"]
    assert moved[0]["center"][0] == pytest.approx(x + 0.5, abs=0.03)
    assert moved[1]["center"] != yaml.safe_load(before)["obstacles"][1]["center"]
    page.picture("12_moved")
    hour.keys("Control+z")
    assert page.yaml == before
    hour.finish(12)
    tools.keyboard.press("Escape")
    page.click(*hour.data["obstacles"][1]["center"])
    tools.wait_for_timeout(400)
    tools.keyboard.press("Control+c")
    mouse.move(*page.at(2.8, 2.4))
    tools.wait_for_timeout(200)
    hour.keys("Control+v")
    assert [each["kind"] for each in hour.data["obstacles"]] == ["box", "cylinder", "cylinder"]
    hour.finish(13)
    mouse.click(*page.at(*hour.data["obstacles"][2]["center"]), button="right")
    item = tools.locator(".bk-btn").get_by_text("Delete", exact=True).last
    item.wait_for(state="visible")
    page.picture("14_menu")
    page.changed(item.click)
    assert page.yaml == before
    hour.finish(14)
    page.click(0.5, 1.5)
    tools.wait_for_timeout(500)
    page.changed(lambda: (hour.field("rate").fill("0.5 g/min"), tools.keyboard.press("Enter")))
    assert hour.data["gas"]["sources"][0]["rate"] == "0.5 g/min"
    hour.finish(15)
    before = page.yaml
    hour.field("rate").fill("-3")
    tools.keyboard.press("Enter")
    tools.get_by_text("refused: rate").wait_for()
    assert page.yaml == before
    hour.finish(16)
    page.click(3.5, 1.0)
    tools.wait_for_timeout(500)
    page.picture("17_team")
    hour.line("algorithm").get_by_text("open ›").click()
    tools.wait_for_timeout(500)
    page.changed(lambda: hour.field("kind").select_option("spiral"))
    assert hour.data["robots"][0]["algorithm"]["kind"] == "spiral"
    hour.finish(17)
    page.changed(lambda: hour.field("kind").select_option("casting"))
    given = [key for key in hour.data["robots"][0]["algorithm"] if key != "kind"]
    if not given:
        page.changed(lambda: (hour.field("threshold_ppm").fill("7"), tools.keyboard.press("Enter")))
    page.changed(lambda: hour.line("threshold_ppm").get_by_text("↺").click())
    assert "threshold_ppm" not in hour.data["robots"][0]["algorithm"]
    hour.finish(18)
    page.tab("YAML")
    tools.wait_for_selector(EDITOR)
    page.changed(lambda: page.write("duration: 60 s", "duration: 60 s\n"))
    page.changed(lambda: tools.keyboard.type("stop"))
    tools.locator(".ace_autocomplete", has_text="stop_early").wait_for()
    tools.keyboard.press("Enter")
    tools.wait_for_timeout(500)
    page.picture("19_completed")
    page.changed(lambda: tools.keyboard.type("false"))
    assert hour.data["stop_early"] is False
    hour.finish(19)
    good = page.yaml
    page.changed(lambda: page.write("radius: 0.15", "radius: 0.15, size: 3"))
    page.tab("Remarks")
    page.until(lambda: "cylinder 1" in page.text_of("remarks"))
    tools.locator("a[data-act]:visible").filter(has_text="cylinder 1").first.click()
    page.until(lambda: page.text_of("sections") == "obstacles[1]")
    hour.finish(20)
    hour.tools.keyboard.press("Escape")
    last = page.yaml
    steps = 0
    while page.yaml != first:
        hour.keys("Control+z")
        steps += 1
        assert steps < 100
    hour.finish(21)
    for _ in range(steps):
        hour.keys("Control+y")
    assert page.yaml == last
    hour.keys("Control+z")
    assert page.yaml == good
    page.press("▶ Run")
    page.until(lambda: "run 1" in page.text_of("progress"), 30)
    hour.finish(22)
    page.until(lambda: "running" in page.text_of("progress"), 240)
    page.until(lambda: page.text_of("time") > 8, 120)
    hour.finish(23)
    page.choose("time", 3.0)
    page.until(lambda: abs(page.text_of("time") - 3.0) < 1.0)
    hour.finish(24)
    page.until(lambda: re.search("completed|found|early", page.text_of("progress")), 400)
    page.press("latest")
    x, y = hour.data["obstacles"][0]["center"]
    page.choose("time", 20.0)
    tools.wait_for_timeout(500)
    page.changed(lambda: page.drag((x, y), (x + 0.4, y + 0.3)))
    hour.finish(25)
    page.press("▶ Run")
    page.until(lambda: "run 2" in page.text_of("progress"), 30)
    page.until(lambda: re.search("completed|found|early", page.text_of("progress")), 400)
    page.choose("other", "1")
    page.choose("time", 20.0)
    tools.wait_for_timeout(1500)
    page.picture("26_difference")
    page.choose("way", "side by side")
    tools.wait_for_timeout(1500)
    hour.finish(26)
    tools.locator(".slick-row").filter(has_text="lesson-1").or_(
        tools.locator(".slick-row").nth(1)
    ).first.click()
    page.until(lambda: page.text_of("title") is not None)
    page.choose("title", "before the box was moved")
    page.press("★ Pin")
    tools.wait_for_timeout(800)
    hour.finish(27)
    page.press("▶ Run with 5 seeds")
    page.until(lambda: re.search(r"completed|of \d+", page.text_of("progress")), 60)
    tools.wait_for_timeout(3000)
    page.picture("28_going")
    page.until(lambda: "completed" in page.text_of("progress"), 600)
    hour.finish(28)
    hour.menu("Example …")
    page.choose("files", "arena_3d")
    page.press("Draw")
    page.until(lambda: "name: arena_3d" in page.yaml)
    page.press("Whole room")
    page.tab("3-D")
    viewer = page.until(lambda: next((f for f in tools.frames if "room.rrd" in f.url), None), 60)
    viewer.wait_for_selector("canvas.visible", timeout=120_000)
    tools.wait_for_timeout(5_000)
    hour.finish(29)
    page.tab("Form")
    page.tool("source")
    page.changed(lambda: page.click(1.0, 1.0))
    text = page.yaml
    page.served.process.kill()
    page.served.process.wait()
    tools.wait_for_selector("[role=alert]")
    page.picture("30_lost")
    with serving(tmp_path, "arena_3d.yaml") as served:
        again = Browser(tools.context.browser.new_context().new_page(), served)
        again.changed(lambda: again.press("Yes"))
        assert again.yaml == text
        hour.finish(30)
    assert len(TASKS) == hour.done == 30
    assert read_scenario(tmp_path / "lesson.yaml").name == "room"
    assert page.errors == []
    assert page.elsewhere == []
