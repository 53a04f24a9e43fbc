"""Progress of checks and other work before the runs of a study."""

import itertools

import pytest

from taichi_plume.studies import progress


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def worked(clock, parts: int, seconds: float, shown: bool = True) -> int:
    count = 0
    for _ in progress.watched(range(parts), parts, "points are checked", shown):
        clock[0] += seconds
        count += 1
    return count


def test_long_work_is_reported_with_the_time_left(clock, capsys):
    """Fifty thousand points at 6 ms each: five minutes."""
    assert worked(clock, 50_000, 0.006) == 50_000
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 5
    done = [int(line.split(" of 50,000 points are checked, about ")[0].replace(",", "")) for line in lines]
    assert done[0] == pytest.approx((progress.QUIET_S + progress.FIRST_S) / 0.006, rel=0.01)
    assert [b - a for a, b in itertools.pairwise(done)] == pytest.approx([10_000] * 4, rel=0.01)
    assert lines[0].endswith("about 5 min left")
    assert lines[-1].endswith("about 49 s left")


@pytest.mark.parametrize(("parts", "shown"), [(100, True), (50_000, False)])
def test_short_work_and_quiet_commands_say_nothing(clock, capsys, parts, shown):
    assert worked(clock, parts, 0.006, shown) == parts
    assert capsys.readouterr() == ("", "")


def test_a_bar_at_a_terminal_is_closed_when_the_work_fails(clock, monkeypatch):
    made = []

    class Bar:
        done = 0

        def __init__(self, total, done, shown, what):
            made.append((total, done, what))

        def __enter__(self):
            return self

        def __exit__(self, *_):
            made.append("closed")

        def advance(self, count):
            self.done += count

        def update(self):
            pass

    monkeypatch.setattr(progress, "Display", Bar)
    parts = progress.watched(range(10), 10, "points", True)
    for part in parts:
        clock[0] += 0.6
        if part == 5:
            break
    parts.close()  # as when an error ends the loop
    assert made == [(10, 2, "points"), "closed"]
