"""Gradient to the source, change and recovery of gas maps with known values."""

import numpy as np
import pytest

from taichi_plume.scoring.map_quality import (
    BEFORE,
    RECOVERY,
    gradient_to_source,
    recovered_jumps,
    relative_change,
)

CELL, SHAPE = 0.25, (16, 12)
CENTERS = (np.indices(SHAPE).transpose(1, 2, 0) + 0.5) * CELL
SOURCE = np.array([1.7, 2.0])


def bell(source):
    return np.exp(-2.0 * ((CENTERS - source) ** 2).sum(axis=-1))


def test_a_bell_leads_to_its_middle_from_everywhere():
    maps = np.stack([bell(SOURCE), -bell(SOURCE), 5.0 + 100.0 * bell(SOURCE)])
    assert gradient_to_source(maps, CELL, SOURCE) == pytest.approx([1.0, 0.0, 1.0])


def test_a_slope_leads_to_the_source_from_one_side():
    """Rising along x: from the cells whose centres have a smaller x, 7 of 16 rows."""
    slope = CENTERS[..., 0]
    assert gradient_to_source(slope[None], CELL, np.array([1.8, 2.0])) == pytest.approx(7 / 16)
    assert gradient_to_source(-slope[None], CELL, np.array([1.8, 2.0])) == pytest.approx(9 / 16)


def test_a_map_without_a_gradient_leads_nowhere():
    flat, unknown = np.full(SHAPE, 3.0), np.full(SHAPE, np.nan)
    assert np.isnan(gradient_to_source(np.stack([flat, unknown]), CELL, SOURCE)).all()
    half = np.where(CENTERS[..., 0] < 1.0, bell(SOURCE), np.nan)
    assert gradient_to_source(half[None], CELL, SOURCE) == pytest.approx(1.0)


def test_the_change_is_a_fraction_of_the_range():
    now = np.stack([bell(SOURCE)] * 3)
    width = np.ptp(now[0])
    before = now + np.array([0.0, 0.1 * width, 0.3 * width])[:, None, None]
    assert relative_change(before, now) == pytest.approx([0.0, 0.1, 0.3])
    assert relative_change(7.0 * before, 7.0 * now) == pytest.approx([0.0, 0.1, 0.3])
    before[1, :8] = np.nan
    assert relative_change(before[1:2], now[1:2]) == pytest.approx([0.1 * width / np.ptp(now[1, 8:])])
    assert np.isnan(relative_change(before, np.ones((3, *SHAPE)))).all()


def series(*late):
    return np.array([*[1.0] * BEFORE, *late])


@pytest.mark.parametrize(
    ("errors", "changes", "expected"),
    [
        ((3.0, 2.9, 1.9, 1.0), (2.0, 1.0, 1.0, 1.0), (1, 1)),  # halfway back after two snapshots
        ((3.0, 2.9, 2.1, 2.1), (2.0, 1.0, 1.0, 1.0), (0, 1)),  # not halfway
        ((3.0, 2.9, 2.1, 2.1, 1.0), (2.0, 1.0, 1.0, 1.0, 1.0), (0, 1)),  # too late
        ((3.0, 1.0, 1.0, 1.0), (1.9, 1.0, 1.0, 1.0), (0, 0)),  # no change of the data
        ((0.9, 0.5, 0.5, 0.5), (2.0, 1.0, 1.0, 1.0), (0, 0)),  # the map was prepared for it
        ((3.0, 1.0, 1.0), (2.0, 1.0, 1.0), (0, 0)),  # too near the end
        (
            (3.0, 3.0, 3.0, 3.0, 1.0, 1.0, 1.0, 1.0),
            (5.0, 5.0, 5.0, 5.0, 1.0, 1.0, 1.0, 1.0),
            (0, 1),
        ),  # one jump
    ],
)
def test_jumps_and_recoveries_are_counted(errors, changes, expected):
    assert RECOVERY == 3
    assert recovered_jumps(series(*errors), series(*changes)) == expected
