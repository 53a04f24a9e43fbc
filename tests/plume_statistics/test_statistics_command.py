"""The command: probes and film of one run against reductions by pandas and xarray, its files, its page, and faults."""

import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pandas
import pyarrow.parquet as pq
import pytest
import xarray
from scipy.stats import spearmanr
from scripts import refusal

import taichi_plume as tp
from taichi_plume.cli import run
from taichi_plume.cli.statistics import main
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.fluctuations import records
from taichi_plume.fluctuations.bouts import signal
from taichi_plume.fluctuations.sensor_comparison import readings
from taichi_plume.scenario.metal_oxides import MOX_MODELS, MoxSensor

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SCENARIO = """
name: meander
seed: 2
duration: 12
tick: 0.05
domain: {size: [6, 4], spacing: 0.2}
wind: {kind: uniform, velocity: [1, 0], gusts: {intensity: 0.4, time: 0.2}}
gas:
  kind: mixture
  parts:
    - {kind: meandering, width_slope: 0.05, sources: [{position: [0.5, 2], rate: 10 mg/s, radius: 0.05}]}
    - {kind: meandering, species: acetone, sources: [{position: [0.5, 1], rate: 10 mg/s, radius: 0.05}]}
probes:
  every: step
  start: 2
  points:
    - {kind: point, name: one, at: [3, 2.1]}
    - {kind: line, name: across, start: [2, 1], end: [2, 3], count: 21}
    - {kind: grid, name: grid, low: [1, 1], high: [5, 3], counts: [5, 11]}
fields: {rate: 20, quantities: [gas]}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run with probes and a film."""
    file = tmp_path_factory.mktemp("statistics") / "s.yaml"
    file.write_text(SCENARIO)
    out = file.with_name("run")
    assert run.main([str(file), "--out", str(out), "--quiet", "--no-report", "--no-recording"]) == 0
    return out


@pytest.fixture(scope="module")
def found(folder):
    return tp.statistics(folder, gas="ethanol", threshold=20.0)


def test_numbers_of_points_are_those_of_the_table(folder, found):
    """By pandas, with the weights of the trapezoidal rule."""
    table = tp.open_run(folder).probes
    for who, rows in table.groupby(["probe", "point"], observed=True):
        name, point = tuple(who)  # pyright: ignore[reportArgumentType]
        c, t = rows.ethanol_ppm.to_numpy(float), rows.t.to_numpy()
        mean = np.trapezoid(c, t) / np.ptp(t)
        reported = found.points[(found.points.probe == name) & (found.points.point == point)].iloc[0]
        assert reported["mean"] == pytest.approx(mean, rel=1e-5)
        assert reported["rms"] == pytest.approx(
            np.sqrt(np.trapezoid((c - mean) ** 2, t) / np.ptp(t)), rel=1e-4, abs=1e-9
        )
        assert reported.intermittency == pytest.approx(np.trapezoid((c > 20).astype(float), t) / np.ptp(t))
        assert reported.maximum == c.max()
        assert reported.mean_u == pytest.approx(np.trapezoid(rows.wind_x, t) / np.ptp(t), rel=1e-5)
        assert (reported.x, reported.y) == (rows.x.iloc[0], rows.y.iloc[0])
    assert len(found.points) == 1 + 21 + 55
    kinds = [one.probe.kind for one in found.probes]
    assert kinds == ["point", "line", "grid"]
    assert found.probes[2].probe.counts == (5, 11)
    assert (found.begin, found.samples) == (pytest.approx(2.0), 201)


@pytest.mark.parametrize("chunk", [113, 1 << 20])
def test_what_comes_before_a_time_is_left_out(folder, tmp_path, monkeypatch, chunk):
    """By pandas; the time lies in the first chunk or in a later one."""
    from taichi_plume.files import run_tables

    table = tp.open_run(folder).probes
    monkeypatch.setattr(run_tables, "ROW_GROUP", chunk)
    by_call = tp.statistics(folder, gas="ethanol", threshold=20.0, start=7.0)
    assert (by_call.begin, by_call.samples) == (pytest.approx(7.0), 101)
    rows = table[(table.probe == "one") & (table.t > 7.0 - 1e-6)]
    mean = np.trapezoid(rows.ethanol_ppm.to_numpy(float), rows.t) / np.ptp(rows.t)
    assert by_call.points.iloc[0]["mean"] == pytest.approx(mean, rel=1e-5)
    assert by_call.points.iloc[0].maximum == rows.ethanol_ppm.max()
    assert main([str(folder), "--from", "7", "--out", str(tmp_path / "s"), "--no-page"]) == 0


def test_bouts_are_those_of_the_sensor_in_the_record(folder, found):
    """The default metal oxide, which starts in clean air, measures the record of a point by itself."""
    points = found.points
    assert [points.attrs["units"][name] for name in ("bouts_per_min", "bout_amplitude", "mox_std")] == [
        "1/min", "1/s", "1",
    ]  # fmt: skip
    assert np.isfinite(points.bouts_per_min).all()
    assert (points.bouts_per_min > 0).any()
    table = tp.open_run(folder).probes
    row = points[points.probe == "across"].iloc[10]
    c = table[(table.probe == "across") & (table.point == 10)].ethanol_ppm.to_numpy()
    sensor = MoxSensor(kind="mox")
    (ppm,) = np.array(list(readings([sensor], "ethanol", 0.05, c[:, None])))[:, :, 0].T
    later = signal(sensor, ppm[len(ppm) // 2 :])
    assert row.mox_std == pytest.approx(later.std(), rel=0.02)
    summary = found.summary["bouts"]
    away = np.linalg.norm(points[["x", "y"]].to_numpy() - (0.5, 2.0), axis=1)
    away = np.minimum(away, np.linalg.norm(points[["x", "y"]].to_numpy() - (0.5, 1.0), axis=1))
    assert summary["points"] == len(points)
    assert summary["rank_correlation_with_distance"] == pytest.approx(
        spearmanr(away, points.bouts_per_min).statistic
    )
    assert any(subject == "bouts" for subject, _ in found.rows)


def test_a_coarse_record_has_no_bouts(folder, tmp_path):
    def thinned(table):
        return table.take(np.flatnonzero(np.arange(len(table)) // 77 % 6 == 0))

    copy = broken(folder, tmp_path, rewritten(thinned))
    coarse = tp.statistics(copy, gas="ethanol", threshold=20.0)
    assert coarse.bouts is None
    assert "bouts_per_min" not in coarse.points
    assert any("too far apart to count bouts" in note for note in coarse.notes)


def test_durations_are_listed(found):
    for name, kind in (("whiffs", 0), ("blanks", 1)):
        table = found.durations[found.durations.kind == name]
        assert len(table) == found.points[name].sum()
        for one in found.probes:
            assert (table.probe == one.probe.name).sum() == len(one.kinds[kind].all.lasted)
    assert (found.durations.duration > 0).all()


def test_a_table_in_small_chunks_says_the_same(folder, found, monkeypatch):
    from taichi_plume.files import run_tables
    from taichi_plume.fluctuations import analysis

    monkeypatch.setattr(run_tables, "ROW_GROUP", 113)
    monkeypatch.setattr(analysis, "MOST_VALUES", 7 * found.samples)
    again = tp.statistics(folder, gas="ethanol", threshold=20.0)
    pandas.testing.assert_frame_equal(again.points, found.points, rtol=1e-9)
    pandas.testing.assert_frame_equal(again.spectra, found.spectra, rtol=1e-5)
    assert again.summary["probes"][1]["whiffs"] == found.summary["probes"][1]["whiffs"]


def test_maps_are_those_of_the_film(folder, found):
    fields = tp.open_run(folder).fields.ethanol_ppm.astype(float)
    t = fields.time.to_numpy()
    maps = found.maps
    mean = fields.integrate("time").transpose("x", "y").to_numpy() / np.ptp(t)
    np.testing.assert_allclose(maps["mean"].to_numpy(), mean, rtol=1e-5)
    present = (fields > 20).astype(float).integrate("time").transpose("x", "y").to_numpy() / np.ptp(t)
    np.testing.assert_allclose(maps["intermittency"].to_numpy(), present, atol=1e-6)
    np.testing.assert_allclose(maps["maximum"].to_numpy(), fields.max("time").transpose("x", "y").to_numpy())


def test_a_film_by_itself(folder, tmp_path, capsys, monkeypatch):
    film = tmp_path / "air.zarr"
    shutil.copytree(folder / "fields.zarr", film)
    monkeypatch.chdir(film)
    assert main([".", "--gas", "ethanol", "--from", "3"]) == 0
    out = tmp_path / "air-statistics"
    assert {path.name for path in out.iterdir()} == {
        "statistics.json", "statistics.parquet", "durations.parquet", "spectra.parquet", "maps.nc", "statistics.html",
    }  # fmt: skip
    reported = json.loads((out / "statistics.json").read_text())
    assert reported["of"] == "film"
    assert reported["begin_s"] == pytest.approx(3.0)
    names = [one["name"] for one in reported["probes"]]
    assert names[0] == "along x"
    assert sum(name.startswith("across at x = ") for name in names) >= 3
    with xarray.open_dataset(out / "maps.nc") as maps:
        assert maps["mean"].attrs["units"] == "ppm"
    assert "between the frames" in capsys.readouterr().out
    lines = tp.statistics(film, gas="ethanol", start=3.0)
    assert lines.maps is not None
    mean = lines.maps["mean"]
    for one in lines.probes:
        for place, value in zip(one.probe.places, one.points["mean"], strict=True):
            assert value == pytest.approx(float(mean.sel(x=place[0], y=place[1], method="nearest")), rel=1e-5)


def test_files_and_page(folder, tmp_path, capsys):
    argv = [str(folder), "--gas", "ethanol", "--threshold", "20", "--out", str(tmp_path / "out")]
    sensor = "{kind: pid, rise_time: 20 ms, decay_time: 20 ms, period: 50 ms}"
    assert main([*argv, "--sensor", sensor]) == 0
    said = capsys.readouterr().out
    assert "of 50 ms" in said
    page = (tmp_path / "out" / "statistics.html").read_text(encoding="utf-8")
    assert "default-src 'none'" in page
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", page)
    assert "<script" not in page
    for words in (
        "20 ppm",
        "as given",
        "acetone",
        "photo-ionisation detector, 20 ms",
        "Celani",
        "Maps",
        "-3/2",
        "Bouts of a metal oxide",
        "bouts a minute at 77 points",
    ):
        assert words in page
    reported = json.loads((tmp_path / "out" / "statistics.json").read_text())
    assert len(reported["sensors"]) == 5 + len(MOX_MODELS)
    assert reported["threshold_ppm"] == 20.0
    table = pq.read_table(tmp_path / "out" / "statistics.parquet")
    assert len(table) == 77
    assert main([*argv, "--no-page", "--probe", "one", "--out", str(tmp_path / "other")]) == 0
    assert not (tmp_path / "other" / "statistics.html").exists()
    assert len(pq.read_table(tmp_path / "other" / "statistics.parquet")) == 1


def test_names_of_a_foreign_table_are_text(folder, tmp_path, capsys):
    copy = broken(folder, tmp_path, lambda copy: None)
    table = pq.read_table(copy / "probes.parquet")
    rows = table.slice(0, len(table) // 77 * 77)
    names = [f"<script>\x1b{name}$x_1$" for name in rows["probe"].to_pylist()]
    where = rows.schema.get_field_index("probe")
    pq.write_table(rows.set_column(where, "probe", [names]), copy / "probes.parquet")
    assert main([str(copy), "--gas", "ethanol"]) == 0
    assert "\x1b" not in capsys.readouterr().out
    page = (copy / "statistics" / "statistics.html").read_text(encoding="utf-8")
    assert "<script>" not in page
    assert r"&lt;script&gt;\x1bone$x_1$" in page


def test_the_default_threshold_is_a_tenth_of_the_strongest_mean(folder, found):
    default = tp.statistics(folder, gas="ethanol", probe="across")
    across = found.points[found.points.probe == "across"]
    assert default.threshold == pytest.approx(0.1 * across["mean"].max(), rel=1e-6)
    assert "tenth" in default.why


def test_shapes_of_probes():
    grid = np.stack(np.meshgrid([0.0, 1.0], [0.0, 0.5, 1.0], indexing="ij"), -1).reshape(-1, 2)
    assert records.Probe.of("a", grid).counts == (2, 3)
    assert records.Probe.of("a", np.linspace([0, 0], [1, 1], 4)).kind == "line"
    assert records.Probe.of("a", grid[::-1]).kind == "line"
    assert records.Probe.of("a", np.array([[1.0, 2.0]])).kind == "point"


def broken(folder, tmp_path, change):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "manifest.json").unlink()
    change(copy)
    return copy


def status(word):
    def change(copy):
        content = json.loads((copy / "result.json").read_text()) | {"status": word}
        (copy / "result.json").write_text(json.dumps(content))

    return change


def no_input(copy):
    (copy / "probes.parquet").unlink()
    shutil.rmtree(copy / "fields.zarr")


def rewritten(change):
    """Another table of probes."""

    def of(copy):
        file = copy / "probes.parquet"
        pq.write_table(change(pq.read_table(file)), file)

    return of


def cut(copy):
    file = copy / "probes.parquet"
    file.write_bytes(file.read_bytes()[:-2000])


def nowhere_film(copy):
    (copy / "probes.parquet").unlink()
    for file in (copy / "fields.zarr" / "acetone_ppm").rglob("*"):
        if file.is_file() and file.name != "zarr.json":
            file.write_bytes(b"damage")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (status("running"), "still running"),
        (lambda copy: (copy / "probes.arrows").touch(), "was killed"),
        (no_input, "neither probes.parquet nor fields.zarr"),
        (cut, "probes.parquet"),
        (rewritten(lambda table: table.slice(0, 0)), "holds no row"),
        (rewritten(lambda table: table.slice(30)), "damaged"),
        (rewritten(lambda table: table.drop_columns(["t"])), "damaged"),
        (nowhere_film, "fields.zarr"),
        (lambda copy: (copy / "probes.parquet").write_text("no"), "probes.parquet"),
    ],
)
def test_runs_that_cannot_be_used_are_reported_in_a_line(folder, tmp_path, capsys, change, words):
    copy = broken(folder, tmp_path, change)
    assert words in refusal(capsys, "statistics", str(copy))
    assert not (copy / "statistics").exists()


def test_a_run_that_was_killed_and_repaired_is_used_and_reported(folder, tmp_path):
    copy = broken(folder, tmp_path, status("killed"))
    found = tp.statistics(copy, gas="ethanol", probe="one", threshold=20.0)
    assert any("ended as 'killed'" in note for note in found.notes)


def test_bad_input_is_reported_before_taichi_is_imported(tmp_path):
    code = (
        "import sys; from taichi_plume.cli.statistics import main; code = main([sys.argv[1]]); "
        "assert not {'taichi', 'matplotlib', 'scipy.stats'} & sys.modules.keys(); sys.exit(code)"
    )
    made = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True)
    assert (made.returncode, made.stderr.count("\n")) == (2, 1), made.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--gas", "helium"], "holds no helium, only ethanol, acetone"),
        (["--probe", "\x1bx"], r"has no probe \x1bx"),
        (["--from", "11.9"], "at least 16 are needed"),
        (["--from", "99"], "holds 0 samples from 99 s on"),
        (["--sensor", "{kind: nose}"], "known kinds: mox, pid, ideal"),
        (["--sensor", "{kind: pid, rise_time: 1 kg}"], "--sensor.rise_time"),
        (["--out", "/dev/null/x"], "/dev/null/x: "),
    ],
)
def test_options_that_do_not_fit_are_reported_in_a_line(folder, capsys, options, words):
    assert main([str(folder), *options]) == (1 if "--out" in options else 2)
    reported = capsys.readouterr().err
    assert words in reported
    assert reported.count("\n") == 1


def test_what_is_no_run_is_reported(tmp_path):
    for path in (tmp_path / "nowhere", tmp_path):
        with pytest.raises(RunFolderError, match=r"give the folder of a run|neither the folder"):
            tp.statistics(path)
    (tmp_path / "file").write_text("")
    with pytest.raises(RunFolderError, match="no folder"):
        tp.statistics(tmp_path / "file")


@pytest.mark.parametrize("name", ["statistics.json", "maps.nc", "spectra.parquet", "statistics.html"])
def test_files_of_the_users_are_not_replaced(found, tmp_path, name):
    """Earlier statistics are, and a link is not followed."""
    names = {path.name for path in found.write(tmp_path / "earlier")} | {"statistics.html"}
    if name not in names:
        pytest.skip("these statistics have no such file")
    mine = tmp_path / "mine" / name
    mine.parent.mkdir()
    mine.write_text("{}")
    with pytest.raises(RunFolderError, match=name):
        found.write(mine.parent)
    assert [(file.name, file.read_text()) for file in mine.parent.iterdir()] == [(name, "{}")]
    if name != "statistics.json":  # which marks the folder
        again = tmp_path / "earlier" / name
        again.unlink(missing_ok=True)
        again.symlink_to(mine)
    found.write(tmp_path / "earlier")
    assert mine.read_text() == "{}"
