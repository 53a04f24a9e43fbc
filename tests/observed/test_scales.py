import numpy as np
import pytest

from taichi_plume.observed.scales import Scale, decades, logarithmic, rounded_up


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_bytes_give_the_value_within_half_a_step_and_the_ends_beyond(dtype):
    scale = Scale(0.3, 3000.0, "log")
    values = np.geomspace(0.31, 2990.0, 500).astype(dtype)
    reported = scale.low * (scale.high / scale.low) ** (scale.bytes(values) / 255)
    step = (scale.high / scale.low) ** (1 / 255)
    assert np.abs(np.log(reported / values)).max() <= 0.5 * np.log(step) + 1e-5
    scale = Scale(290.0, 300.0, "linear")
    values = np.linspace(290, 300, 333).astype(dtype)
    assert np.abs(290 + 10 * (scale.bytes(values) / 255) - values).max() <= 0.5 * 10 / 255 + 1e-4

    for scale in (Scale(0.1, 1000.0, "log"), Scale(0.1, 1000.0, "linear")):
        assert scale.bytes(np.array([-1.0, 0.0, 0.1, 1000.0, 1e9, np.nan])).tolist() == [0, 0, 0, 255, 255, 0]


def test_marks_are_round_numbers_where_they_belong():
    for scale in (Scale(293.15, 296.6, "linear"), Scale(200.0, 450.0, "linear"), Scale(0.1, 1000.0, "log")):
        marks = scale.marks()
        assert 4 <= len(marks) <= 8
        for at, text in marks:
            place = np.log(float(text) / scale.low) / np.log(scale.high / scale.low)
            linear = (float(text) - scale.low) / (scale.high - scale.low)
            assert at == pytest.approx(place if scale.kind == "log" else linear, abs=1e-6)


def test_logarithmic_scale():
    places = logarithmic(np.array([0.0, 0.1, 1.0, 10.0, 1e9, np.nan]), 0.1, 1000.0)
    assert places[:5] == pytest.approx([0, 0, 0.25, 0.5, 1])
    assert np.isnan(places[5])
    marks = decades(0.1, 1000.0)
    assert [label for _, label in marks] == ["0.1", "1", "10", "100", "1000"]
    assert [at for at, _ in marks] == pytest.approx([0, 0.25, 0.5, 0.75, 1])


@pytest.mark.parametrize(
    ("value", "next_one"), [(0.34, 0.5), (0.5, 0.5), (1.01, 1.5), (0.0071, 0.01), (28.0, 30.0)]
)
def test_keys_are_round_numbers(value, next_one):
    assert rounded_up(value) == pytest.approx(next_one)
