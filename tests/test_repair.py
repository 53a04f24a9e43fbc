"""What a killed run has left is completed, whenever it was killed; what is whole stays as it is."""

from pathlib import Path

import fake_run
import pyarrow.parquet as pq
import pytest
from refusals import flipped, unfinished
from scripts import read_result

from taichi_plume.__main__ import main
from taichi_plume.assembly import assemble
from taichi_plume.cli import run
from taichi_plume.execution import result
from taichi_plume.files import checkpoint, manifest

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]


@pytest.fixture
def finished(tmp_path, monkeypatch) -> Path:
    """The directory of a run that is over."""
    monkeypatch.setattr(
        assemble, "build", lambda _, driven: fake_run.simulation(fake_run.scenario(2, duration=2, maps=[]))
    )
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.yaml").write_text(
        "domain: {size: [2.0, 1.5], spacing: 0.1}\nduration: 2\nwind: {kind: uniform, velocity: [0.3, 0]}\n"
        "gas: {kind: gaussian_plume, sources: [{position: [0.4, 0.75], rate: 1e-6}], diffusivity: 0.01}\n"
    )
    assert run.main(["a.yaml", "--out", "out", "--quiet", "--no-recording"]) == 0
    return tmp_path / "out"


def cut_off(folder: Path, status: str = "running") -> None:
    """Make it one whose process was killed before its table was finished."""
    unfinished(folder / "robots.parquet")
    (folder / manifest.NAME).unlink()
    result.write_result(folder, read_result(folder) | {"status": status})


@pytest.mark.parametrize("status", ["running", "disk_full", "interrupted"])
def test_a_stream_becomes_a_table_however_the_run_ended(finished, capsys, status):
    """The disk may have been full when the table was to be written."""
    rows = pq.read_table(finished / "robots.parquet")
    cut_off(finished, status)
    assert main(["repair", str(finished)]) == 0
    assert pq.read_table(finished / "robots.parquet").equals(rows)
    assert read_result(finished)["status"] == ("killed" if status == "running" else status)
    assert f"robots.parquet: {len(rows):,} rows" in capsys.readouterr().out
    assert main(["repair", "--verify", str(finished)]) == 0
    before = {file.name: file.read_bytes() for file in finished.iterdir()}
    assert main(["repair", str(finished)]) == 0
    assert {file.name: file.read_bytes() for file in finished.iterdir()} == before


def test_a_report_that_is_made_again_is_no_damage(finished):
    """It tells of the manifest, too, which was not there when the run wrote it."""
    before = (finished / "report.html").read_bytes()
    assert main(["report", str(finished)]) == 0
    assert (finished / "report.html").read_bytes() != before
    assert main(["repair", "--verify", str(finished)]) == 0


@pytest.mark.parametrize("content", [None, "", "{", "[]", "{}", "3", "[" * 9999])
def test_a_result_that_says_nothing_is_of_a_killed_run(finished, content):
    cut_off(finished)
    (finished / "result.json").unlink()
    if content is not None:
        (finished / "result.json").write_text(content)
    assert main(["repair", str(finished)]) == 0
    assert read_result(finished)["status"] == "killed"
    assert (finished / "robots.parquet").exists()


def test_what_is_damaged_does_not_keep_the_rest_from_being_completed(finished, capsys):
    cut_off(finished)
    flipped("robots.arrows", 0)(finished)  # the mark at which the stream begins
    (finished / "plume.pslog").write_bytes(b"")
    (finished / "forces.csv").write_text("t_s,obstacle,x_N,y_N\n0,0,1,2\n1,0,3")
    assert main(["repair", str(finished)]) == 1
    said = capsys.readouterr().out
    assert "robots.parquet: could not be completed:" in said
    assert "plume.pslog: could not be completed:" in said
    assert (finished / "forces.csv").read_text() == "t_s,obstacle,x_N,y_N\n0,0,1,2\n"
    assert (finished / "robots.arrows").exists(), "what can still be read stays"


def test_a_run_that_was_killed_at_its_very_end_is_over(finished):
    """Its result was written, but not its manifest; or its checkpoint was not yet removed."""
    checkpoint.write(finished / checkpoint.NAME, {"inputs": {}})
    (finished / manifest.NAME).unlink()
    (finished / "report.html").unlink(missing_ok=True)
    assert main(["repair", str(finished)]) == 0
    assert (finished / "report.html").exists()
    assert not (finished / checkpoint.NAME).exists()
    assert main(["repair", "--verify", str(finished)]) == 0
    assert read_result(finished)["status"] == "completed"
