import base64
import io
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import made_run
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image
from refusals import unfinished
from scripts import refusal

from taichi_plume.__main__ import main
from taichi_plume.agents import algorithm_table, mapping
from taichi_plume.assembly import solver_table
from taichi_plume.execution.result import write_result
from taichi_plume.record.layout import MAP_TITLES
from taichi_plume.report import captions, facts, figures, maps, references, theme
from taichi_plume.report.page import NAME
from taichi_plume.results.run import Run

ROOT = Path(__file__).parent.parent.parent
ADDRESSES = {"src", "href", "action", "data", "poster", "srcset", "background", "formaction", "cite", "ping"}
VOID = {"meta", "img", "br", "link", "hr", "input"}
GMRF = {"kind": "gmrf", "cell": 0.5}


class Read(HTMLParser):
    """Parsed page: tags, attributes and texts; every tag is closed."""

    def __init__(self, html: str):
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.open: list[str] = []
        self.texts: list[str] = []
        self.feed(html)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, {key: value or "" for key, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] != ["style"]:
            self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())

    @property
    def titles(self) -> list[str]:
        return [attrs["alt"].partition(".")[0] for tag, attrs in self.tags if tag == "img"]


@pytest.fixture
def report(capsys):
    """Write and read the page of a folder."""

    def make(folder: Path) -> Read:
        assert main(["report", str(folder)]) == 0
        assert str(folder / NAME) in capsys.readouterr().out
        return Read((folder / NAME).read_text(encoding="utf-8"))

    return make


def test_nothing_leaves_the_page_and_images_have_words(tmp_path, report):
    page = report(made_run.made(tmp_path / "run"))
    for tag, attrs in page.tags:
        assert tag not in ("script", "link", "iframe", "object", "embed", "base", "form")
        assert not [key for key in attrs if key.startswith("on")]
        for key in ADDRESSES & attrs.keys():
            assert attrs[key].startswith(("data:image/png;base64,", "#")), (tag, key)
    policies = [attrs for _, attrs in page.tags if attrs.get("http-equiv") == "Content-Security-Policy"]
    assert "default-src 'none'" in policies[0]["content"]
    assert not re.search(r"url\(|@import|https?:", (tmp_path / "run" / NAME).read_text())
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    links = {attrs["href"][1:] for _, attrs in page.tags if "href" in attrs}
    assert links
    assert links <= ids
    images = [attrs for tag, attrs in page.tags if tag == "img"]
    assert len(images) == 3
    for one in images:
        image = Image.open(io.BytesIO(base64.b64decode(one["src"].partition(",")[2])))
        assert image.size[0] == round(figures.WIDE * figures.DPI)
        assert len(one["alt"]) > 60


WORDS = "<script>alert(1)</script> $\\frac{1}{0}$ 日本 \"'&amp;"
WICKED = f"{WORDS} \x1b[2J"


@pytest.mark.parametrize(
    ("status", "found", "shown"),
    [
        ("stopped", 2, "source found no more to do"),
        ("stopped", 1, "ended early no more to do"),
        ("completed", 2, "completed no more to do"),
    ],
)
def test_success_is_named_and_counts_robots(tmp_path, report, status, found, shown):
    """The page says that the source was found; a single trial has no success rate in per cent."""
    model = made_run.scenario()
    result = made_run.result(model, status=status, message="no more to do")
    result["groups"][0]["per_trial"]["found"] = [found]
    page = report(made_run.made(tmp_path / "run", model, content=result))
    assert shown in page.text
    assert "stopped" not in page.text
    assert f"found a source {found} of 2 robots" in page.text
    assert "100 %" not in page.text


def test_success_of_many_trials_is_a_percentage_of_trials():
    group = made_run.result(made_run.scenario())["groups"][0] | {"trials": 4}
    group["per_trial"] = {"found": [2, 1, 0, 2]}
    group["summary"]["success_rate"] = {"mean": 0.75, "low": 0.3, "high": 0.95, "n": 4, "airs": 1}
    rows = {row[0]: row[1:] for row in facts.trials(group)}
    assert rows["found a source"][0] == "5 of 8 robots"
    assert rows["success"][:2] == ("75 %", "30 to 95 %")


def test_each_error_of_a_map_has_a_name_of_its_own(drawn):
    """The error over time is against the mean gas; the other error is against the gas at the end."""
    over_time = {"time_s": [5, 10], "error_ppm": [7.0, 5.94], "correlation": [0.5, 0.6]}
    score = {
        "kind": "gmrf",
        "mae_ppm": 8.98,
        "correlation": 0.7,
        "known_fraction": 1.0,
        "mean_gas": over_time,
    }
    (row,) = facts.map_rows([score])
    named = dict(zip(captions.MAP_HEADS, row, strict=True))
    assert len(named) == len(captions.MAP_HEADS)
    figures.scores([score], ["gmrf"], captions.GAS_TITLES)
    shown = [(axes.get_title(loc="left"), axes.lines[0].get_ydata()[-1]) for axes in drawn[0].axes]
    assert [named[title] for title, _ in shown] == [f"{value:.3g}" for _, value in shown[:1]] + ["0.60"]
    assert {"8.98", "0.70"} <= set(named.values())
    assert [title.lower() for title in MAP_TITLES[:2]] == [title for title, _ in shown]


def test_names_stay_text(tmp_path, report):
    """Names of scenario, group and species, message, remark, and the command on top of scenario.yaml."""
    model = made_run.scenario()
    group = model.robots[0].model_copy(update={"name": WORDS})
    folder = made_run.made(tmp_path / "run", model.model_copy(update={"robots": (group,)}))
    keys = {"message": WICKED, "remarks": [WICKED], "name": WICKED, "status": "<b>odd", "version": "<i>"}
    reported = made_run.result(model, **keys)
    reported["groups"][0]["name"] = WORDS
    write_result(folder, reported)
    shutil.rmtree(folder / "pictures.zarr")
    made_run.record(folder / "pictures.zarr", quantity=WICKED)
    file = folder / "scenario.yaml"
    head, _, rest = file.read_text(encoding="utf-8").partition("\n")
    file.write_text(f"{head} <img src=x onerror=alert(1)>\n{rest}", encoding="utf-8")
    page = report(folder)
    assert not [tag for tag, _ in page.tags if tag in ("script", "b", "i") and tag != "b"]
    assert not [attrs for tag, attrs in page.tags if "onerror" in attrs or attrs.get("src") == "x"]
    assert page.text.count("<script>alert(1)</script>") >= 5
    assert "\x1b" not in (folder / NAME).read_text(encoding="utf-8")


SERIES = "Readings and behaviour over time"
PARTS = (
    "1 of 2 robots found a source", "found a source 1 of 2 robots", "one thing is unlikely",
    "Mean of 21 recorded pictures", "Lochmatter & Martinoli", "python -m taichi_plume.run",
    "seed: 0", "0.01 g", "1.0e-08 of the incoming mass",
)  # fmt: skip


@pytest.mark.parametrize(
    ("dim", "changes", "recording", "titles", "words"),
    [
        (2, {}, True, ["Mean ethanol", SERIES], PARTS),
        (3, {}, True, ["Mean ethanol, maximum over the height", "Mean ethanol, y = 1", SERIES], ()),
        (2, {"robots": []}, True, ["Mean ethanol"], ()),
        (2, {}, False, ["Tracks", SERIES], ("neither a recording nor recorded fields",)),
        (2, {"maps": [GMRF]}, True, ["Mean ethanol", SERIES], ("no maps.zarr", "Monroy, Blanco")),
    ],
    ids=["2-D", "3-D", "no robots", "no recording", "no maps.zarr"],
)
def test_the_page_shows_what_there_is(tmp_path, report, dim, changes, recording, titles, words):
    model = made_run.scenario(dim, **changes)
    page = report(made_run.made(tmp_path / "run", model, recording=recording))
    assert page.titles == ["The scene", *titles]
    assert not [one for one in words if one not in page.text]
    assert ("Sensor readings and behaviour" in page.text) == (changes.get("robots") != [])


def test_runs_that_failed_are_reported_and_shown(tmp_path, report):
    for status in ("failed", "unstable", "interrupted"):
        reported = {"name": "made", "status": status, "message": "it broke at t = 3 s", "seed": 0}
        page = report(made_run.made(tmp_path / status, content=reported))
        assert f"{status} it broke at t = 3 s" in page.text
        assert "Mean ethanol" in page.titles


def test_a_run_that_was_killed_is_shown_as_far_as_it_came(tmp_path, report):
    reported = {"name": "made", "status": "running", "message": "t = 4.00 s", "seed": 0}
    folder = made_run.made(tmp_path / "run", content=reported)
    (folder / "pictures.zarr" / "gas_slice" / "c" / "0" / "0" / "0").unlink()
    unfinished(folder / "robots.parquet")
    page = report(folder)
    assert "taichi_plume repair" in page.text
    assert "pictures.zarr: is damaged: gas_slice has 0 of 1" in page.text
    assert page.titles == ["The scene", "Tracks", SERIES]


def test_numbers_that_are_none(tmp_path, report):
    """An unstable run: readings, gas and result are no numbers."""
    folder = made_run.made(tmp_path / "run")
    table = pq.read_table(folder / "robots.parquet").to_pandas()
    table.loc[table.t > 3, ["reading_ppm", "true_ppm", "x", "y", "heading"]] = np.nan
    table = table.astype({"group": str, "state": str})
    pq.write_table(pa.Table.from_pandas(table, preserve_index=False), folder / "robots.parquet")
    assert SERIES in report(folder).titles


def test_bad_folders_are_one_line_each(tmp_path, capsys):
    other = made_run.made(tmp_path / "other")
    made_run.reworded(other, frobnicate=3)
    torn = made_run.made(tmp_path / "torn")
    (torn / "robots.parquet").write_bytes(b"PAR1 nothing")
    for folder, words in ((other, "frobnicate"), (torn, "is damaged")):
        said = refusal(capsys, "report", str(folder))
        assert said.startswith(str(folder)), said
        assert words in said
        assert not (folder / NAME).exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"groups": [1]},
        {"groups": [{"name": "pair"}]},
        {"flow": [1]},
        {"gas": {"emitted_kg": "x"}},
        {"maps": [{"kind": "gmrf"}]},
        {"simulated_s": "long"},
    ],
)
@pytest.mark.parametrize("status", ["completed", "killed"])
def test_a_result_that_says_other_things_is_reported_in_a_line(tmp_path, capsys, status, changes):
    """In the page itself if the run did not end by itself."""
    model = made_run.scenario(maps=[GMRF])
    folder = made_run.made(tmp_path / "run", model, content=made_run.result(model, status=status, **changes))
    code, said = main(["report", str(folder)]), capsys.readouterr().err
    if status == "killed":
        assert code == 0
        said = Read((folder / NAME).read_text(encoding="utf-8")).text
    else:
        assert (code, said.count("\n")) == (2, 1)
        assert said.startswith(f"{folder / 'result.json'}: ")
    assert f"{folder / 'result.json'}: is damaged, or of another version" in said


def test_thousands_of_trials_make_a_small_page(tmp_path, report):
    """Some of many robots are shown, and the peaks of long series."""
    area = {"kind": "area", "low": [2, 0.3], "high": [3.8, 2.7]}
    team = {"name": "pair", "count": 2, "trials": 1000, "algorithm": {"kind": "casting"}, "start": area}
    model = made_run.scenario(robots=[team])
    reported = made_run.result(model)
    trials = reported["groups"][0]
    per_trial = {"success": [True] * 1000, "found": [1] * 1000, "time_s": list(np.linspace(2, 9, 1000))}
    trials |= {"trials": 1000, "trials_differ_by": "starts and chance", "per_trial": per_trial}
    page = report(made_run.made(tmp_path / "run", model, trials=200, content=reported))
    assert "Shown are 2 of 2,000 robots" in page.text
    assert "Success over time" in page.titles
    assert (tmp_path / "run" / NAME).stat().st_size < 1e6


def are_inside(boxes, whole) -> bool:
    return all(
        min(box.x0 - whole.x0, whole.x1 - box.x1, box.y0 - whole.y0, whole.y1 - box.y1) >= 0 for box in boxes
    )


@pytest.mark.parametrize("states", [["FIND"], [f"STATE_{n}" for n in range(7)], ["a" * 300, "b", "c"]])
def test_all_letters_of_the_series_are_on_the_figure(tmp_path, drawn, states):
    """However many states there are and however long names are."""
    run = Run(made_run.made(tmp_path / "run"), lenient=True)
    state = np.arange(len(run.tracks[0].t)) % len(states)
    tracks = [one._replace(name="n" * 64, states=states, state=state) for one in run.tracks]
    figures.smelt(run, tracks)
    (figure,) = drawn
    figure.canvas.draw()
    (axes,) = figure.axes
    texts = (axes.get_legend(), axes.xaxis.label, *figure.legends)
    assert are_inside([one.get_window_extent() for one in texts], figure.bbox)
    assert not axes.xaxis.label.get_window_extent().overlaps(axes.get_legend().get_window_extent())


@pytest.mark.parametrize("size", [(4.0, 3.0), (20.0, 0.8), (0.8, 20.0)])
def test_maps_of_rooms_of_any_shape(tmp_path, monkeypatch, drawn, size):
    """Narrow ones have room for the scale and for the titles, side by side and within a page."""
    run = Run(made_run.made(tmp_path / "run"), lenient=True)
    monkeypatch.setattr(type(run.scenario.domain), "extent", size)
    cells = np.ones((round(size[1] / 0.1), round(size[0] / 0.1)))
    maps.beside_truth(run, [maps.MapAtEnd("kernel dmv map", 0.1, cells, cells)] * 2)
    (figure,) = drawn
    figure.canvas.draw()
    whole, (*panels, scale) = figure.bbox, figure.axes
    boxes = [one._left_title.get_window_extent() for one in panels]
    assert are_inside([*boxes, scale.yaxis.label.get_window_extent(), scale.get_tightbbox()], whole)
    assert not boxes[0].overlaps(boxes[1])
    assert scale.bbox.height > 100
    assert whole.height < 1500


def test_long_names_keep_their_ends():
    assert theme.short("casters 12") == "casters 12"
    assert theme.short("n" * 60 + " 7", 12) == "nnnnnn…nnn 7"


def test_a_long_series_keeps_its_peaks():
    t = np.arange(400_000) * 0.1
    values = np.sin(t)
    values[123_456], values[7], values[300_000:300_010] = 50.0, -50.0, np.nan
    short, kept = figures.thinned(t, values)
    assert len(short) <= figures.MOST_POINTS + 10
    assert kept[np.isfinite(kept)].max() == 50.0
    assert kept[np.isfinite(kept)].min() == -50.0
    assert (np.diff(short) >= 0).all()
    assert figures.thinned(t[:100], values[:100])[0] is not None


def test_the_papers_are_those_of_the_kinds_that_are_used():
    maps = [{"kind": "kernel_dmv"}, {"kind": "time_series"}]
    papers = dict(references.papers(made_run.scenario(maps=maps)))
    cited = {
        "search algorithm casting": "ISER 2008",
        "gas map kernel dmv": "IROS 2009",
        "gas map time series": "ICRA 2014",
        "wind synthetic": "10.1017/S0022112092001423",
    }
    assert papers.keys() == cited.keys()
    assert all(text in papers[name] for name, text in cited.items())


def test_papers_are_of_kinds_that_there_are_and_are_cited_where_they_are_used():
    rooms = {"search algorithm": "agents", "gas map": "agents", "gas": "solvers", "wind": "solvers"}
    kinds = (algorithm_table.ALGORITHMS, mapping.KINDS, solver_table.GASES, solver_table.WINDS)
    known = {
        f"{part} {kind.replace('_', ' ')}": room
        for (part, room), table in zip(rooms.items(), kinds, strict=True)
        for kind in table
    }
    sources = {
        room: "".join(path.read_text(encoding="utf-8") for path in (ROOT / room).glob("*.py"))
        for room in rooms.values()
    }
    for paper in references.library():
        assert paper.uses.keys() <= known.keys()
        for kind in paper.uses:
            assert paper.fields["doi"] in sources[known[kind]]
            assert paper.fields["eprint"] in sources[known[kind]]
