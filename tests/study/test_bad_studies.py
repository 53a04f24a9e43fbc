"""What is wrong with a study is told before its first run, a line for each fault."""

import pytest
from small_study import ROOM, SPEED, faults, write

from taichi_plume.study.plan import load_plan

HEIGHT = {"key": "robots.0.sensors.gas.height", "low": "5 cm", "high": 0.3}
COUNT = {"key": "robots.0.count", "low": 1, "high": 8}


@pytest.mark.parametrize(
    ("axis", "begins"),
    [
        (
            {"key": "wind.openings.0.spede", "values": [1, 2]},
            ["axes.a: wind.openings[0]: unknown key 'spede'; did you mean 'speed'?"],
        ),
        ({"key": "wnd.speed", "values": [1, 2]}, ["axes.a: unknown key 'wnd'; did you mean 'wind'?"]),
        (
            {"key": "wind.opening.0.speed", "values": [1, 2]},
            ["axes.a: unknown key 'opening' in wind; did you mean 'wind.openings'?"],
        ),
        ({"key": "wind.openings.9.speed", "values": [1, 2]}, ["axes.a: wind.openings has 2 items"]),
        ({"key": "duration.x", "values": [1]}, ["axes.a.values[0]: duration is 4.0: it has no key 'x'"]),
        ({"key": ".", "values": [1]}, ["axes.a.values[0]: must be the path of a key"]),
        (
            {"key": "wind.openings.0.turbulence_intensity", "values": [0.2, "x", 2, None]},
            [
                "axes.a.values[1]: wind.openings[0].turbulence_intensity: got 'x'",
                "axes.a.values[2]: wind.openings[0].turbulence_intensity: got 2",
                "axes.a.values[3]: wind.openings[0].turbulence_intensity: got nothing",
            ],
        ),
        (
            {"key": "gas.sources.0.rate", "values": ["1 mg/s", "1 kg", 5]},
            [
                "axes.a.values[1]: gas.sources[0].rate: got '1 kg': must have a unit that converts to kg/s",
                "axes.a.values[2]: gas.sources[0].rate: got 5 kg/s; did you mean '5 mg/s'?",
            ],
        ),
        (
            {
                "variants": {
                    "x": {"robots.0.algorithm": {"kind": "castin"}},
                    "y": {"robots.0.algorithm.threshold_ppm": -3},
                }
            },
            [
                "axes.a.variants.x: robots[0].algorithm: unknown kind 'castin'; did you mean 'casting'?",
                "axes.a.variants.y: robots[0].algorithm.threshold_ppm: got -3",
            ],
        ),
        (HEIGHT | {"high": "3 kg", "count": 3}, ["axes.a.high: robots[0].sensors.gas.height: got '3 kg'"]),
        (HEIGHT | {"high": 0.01, "count": 3}, ["axes.a: low must be less than high, got 0.05 and 0.01"]),
        (
            HEIGHT | {"low": 0, "count": 3, "spacing": "log"},
            ["axes.a.low: got 0: with spacing: log it must be more than 0"],
        ),
        (COUNT | {"count": 3}, ["axes.a: robots[0].count takes whole numbers, 4.5 is none"]),
        (
            {"key": "robots.0.name", "low": "a", "high": "b", "count": 3},
            ["axes.a: robots[0].name is no number; give its values"],
        ),
        (
            {"key": "tick", "values": [0.1, "0.1 s", "100 ms"]},
            ["axes.a.values[1]: '0.1 s' is there twice", "axes.a.values[2]: '100 ms' is there twice"],
        ),
        (
            {"key": "duration", "values": [0.35, 0.35 * (1 + 1e-15)]},
            ["axes: points with a: 0.35 and 0.35 are the same run"],
        ),
        (
            {"key": "name", "values": ["a", "b"]},
            ["axes: points with a: a and b are the same run; what differs decides nothing"],
        ),
        (
            {"key": "domain.spacing", "values": [0.1, 1e-6]},
            ["axes.a: 1e-06 m: domain.spacing: "],
        ),
        ({"key": "x"}, ["axes.a: has no values; give either values, or low and high, or variants"]),
        ({"values": [1]}, ["axes.a: needs key, the path of what is varied"]),
        ({"key": "x", "keys": ["y"], "values": [1]}, ["axes.a: needs key, the path of what is varied"]),
        ({"key": "x", "values": [1], "low": 2, "high": 3}, ["axes.a: has values and low; give either"]),
        ({"key": "x", "low": 1}, ["axes.a: has low but no high"]),
        ({"key": "x", "high": 1}, ["axes.a: has high but no low"]),
        ({"key": "x", "values": [1], "count": 3}, ["axes.a: count goes with low and high alone"]),
        ({"key": "x", "variants": {"a": {"tick": 1}}}, ["axes.a: has variants, which name their own keys"]),
        ({"variants": {"a": {}}}, ["axes.a: has a variant that changes nothing"]),
        ({"variants": {" ": {"tick": 0.2}}}, ["axes.a.variants: ' ' is no name of a variant"]),
        ({"keys": ["tick", "tick"], "values": [0.1]}, ["axes.a: changes tick twice"]),
        (
            {"keys": ["wind.openings.0.face", "wind"], "values": [0.1]},
            ["axes.a: changes wind, and wind.openings[0].face, which is a part of it"],
        ),
        ({"key": "x", "valus": [1]}, ["axes.a: unknown key 'valus'; did you mean 'values'?"]),
        (3, ["axes.a: must be a mapping (key: value), got 3"]),
        (HEIGHT, ["axes.a: has low and high; give count, or sampling for the study"]),
    ],
)
def test_axes(tmp_path, axis, begins):
    found = faults(write(tmp_path, axes={"a": axis}))
    assert len(found) == len(begins), found
    for line, begin in zip(found, begins, strict=True):
        assert line.startswith(begin), line


@pytest.mark.parametrize(
    ("keys", "begins"),
    [
        (
            {"axes": {"a": SPEED, "b": {"key": " wind.openings[0].speed", "values": [1]}}},
            ["axes.b: changes wind.openings[0].speed, as axes.a does; a key can be on one axis only"],
        ),
        (
            {"axes": {"a": SPEED, "b": {"key": "wind", "values": [{}]}}},
            ["axes.b: changes wind, and axes.a wind.openings[0].speed, which is a part of it"],
        ),
        (
            {"axes": {"a": {"variants": {"x": {"wind.openings": []}, "y": {"tick": 0.2}}}, "b": SPEED}},
            ["axes.b: changes wind.openings[0].speed, and axes.a wind.openings, of which it is a part"],
        ),
        (
            {
                "axes": {
                    "success": SPEED,
                    "Height": HEIGHT,
                    "by_x": COUNT,
                    "seed": {"key": "tick", "values": [1]},
                }
            },
            [
                "axes.success: is a name that the tables use themselves",
                "axes: 'Height' is no name of a column; use at most 32 small letters",
                "axes.by_x: is a name",
                "axes.seed: is a name",
                "axes.Height: has low and high; give count",
            ],
        ),
        (
            {"axes": {"s": {"key": "seed", "values": [1, 2]}}, "airs": 3, "searches": 2},
            ["airs: the axes give the seeds themselves; remove airs", "searches: the axes give the seeds"],
        ),
        (
            {"axes": {"s": {"variants": {"x": {"air_seed": 1}}}}, "airs": 3},
            ["airs: the axes give the seeds themselves; remove airs"],
        ),
        ({"axes": {"s": {"key": "seed", "values": [-1, 2]}}}, ["axes.s.values[0]: seed: got -1"]),
        ({"axes": {}}, ["axes: must have at least 1 item"]),
        (
            {"sampling": {"kind": "sobol", "count": 60}, "axes": {"h": HEIGHT}},
            ["sampling: count: got 60: a Sobol sequence takes a power of two, such as 32 or 64"],
        ),
        ({"sampling": {"kind": "sobol"}}, ["sampling: no axis is drawn; give one low and high"]),
        (
            {"sampling": {"kind": "latin"}, "axes": {"n": COUNT}},
            ["axes.n: robots[0].count takes whole numbers"],
        ),
        (
            {"kind": "sensitivity", "axes": {"h": HEIGHT, "speed": SPEED}, "samples": 50},
            [
                "axes.speed: a sensitivity study takes low and high without count",
                "samples: got 50: a Sobol sequence takes a power of two, such as 32 or 64",
            ],
        ),
        ({"kind": "sensitivity", "axes": {"n": COUNT}}, ["axes.n: robots[0].count takes whole numbers"]),
        (
            {"kind": "sensitivity", "axes": {"h": HEIGHT}, "sampling": {"kind": "latin"}},
            ["sampling: a sensitivity study draws its points itself"],
        ),
        ({"samples": 64}, ["samples: is for kind: sensitivity"]),
        ({"kind": "refinement"}, ["axes: a refinement study takes one axis, with values of domain.spacing"]),
        (
            {"kind": "refinement", "axes": {"dx": {"key": "domain.spacing", "values": [0.1, 0.05]}}},
            ["axes: a refinement study takes three values or more"],
        ),
        ({"kind": "sweeep"}, ["kind: got 'sweeep'; did you mean 'sweep'?"]),
        ({"name": "a b"}, ["name: got 'a b': must be at most 64 letters"]),
        ({"axis": 3}, ["unknown key 'axis'; did you mean 'axes'?"]),
        (
            {"keep": ["result.json", "fields.zarr", "recording.rd", "../x", "forces.csv"]},
            [
                "keep: fields.zarr: is left only by runs whose scenario has fields",
                "keep: recording.rd: runs leave no such file; did you mean recording.rrd?",
                "keep: ../x: runs leave no such file; they leave scenario.yaml, ",
                "keep: forces.csv: is left only by runs with obstacles and a computed wind",
            ],
        ),
        (
            {
                "outcomes": {
                    "a": "maps.0.correlation",
                    "b": "maps.1.correlation",
                    "c": "maps.0.corelation",
                    "d": "wall_s",
                    "e": "probes.x.wind_x",
                    "f": "groups",
                    "g": "groups.0.summary.time_s.mean",
                    "h": "gas.relative_error",
                    "i": "groups.team.success_rate",
                    "j": "status",
                    "k": "beliefs.0.entropy_bits",
                }
            },
            [
                "outcomes.b: result.json has no maps.1; maps takes 1 of them",
                "outcomes.c: result.json has no number at maps.0.corelation; did you mean maps.0.correlation?",
                "outcomes.d: result.json has no number at wall_s; numbers of result.json: ",
                "outcomes.e: there is no probe 'x'; the scenario has none",
                "outcomes.f: groups holds several numbers",
                "outcomes.i: result.json has no groups.team",
                "outcomes.j: result.json has no number at status",
                "outcomes.k: result.json has no beliefs.0; beliefs takes 0 of them",
            ],
        ),
        (
            {"outcomes": {"speed": "steps", "time_s": "steps", "A": "steps"}},
            [
                "outcomes.speed: is the name of an axis",
                "outcomes.time_s: is a name that the tables use themselves",
                "outcomes: 'A' is no name of a column",
            ],
        ),
        ({"airs": 100_000}, ["has 200,000 runs; at most 100,000 are taken"]),
        ({"base": "nowhere.yaml"}, ["nowhere.yaml: cannot be read: No such file or directory"]),
        ({"base": "../room.yaml"}, ["base: ../room.yaml lies outside the study's folder; "]),
        ({"base": "."}, [".: cannot be read: Is a directory"]),
        ({"base": 3}, ["base: got 3: must be a text"]),
    ],
)
def test_studies(tmp_path, keys, begins):
    found = [line.replace(f"{tmp_path}/", "") for line in faults(write(tmp_path, **keys))]
    if keys.get("base") == ".":
        found = [line.replace(f"{tmp_path}", ".") for line in found]
    assert len(found) == len(begins), found
    for line, begin in zip(found, begins, strict=True):
        assert line.startswith(begin), line


def test_probes_are_those_of_the_scenario(tmp_path):
    room = ROOM | {"probes": {"points": [{"kind": "point", "name": "a.b", "at": [1, 0.5]}]}}
    good = {"a": "probes.a.b.wind_x", "b": "probes.a.b.ethanol_ppm", "c": "probes.a.b.pressure"}
    assert load_plan(write(tmp_path, room, outcomes=good, keep=["probes.parquet"])).study.outcomes == good
    bad = {
        "a": "probes.a.wind_x",
        "b": "probes.a.b.wind_z",
        "c": "probes.a.b.temperature",
        "d": "probes.wind_x",
    }
    found = faults(write(tmp_path, room, outcomes=bad))
    assert found[0] == "outcomes.a: there is no probe 'a'; the scenario has a.b"
    told = "they tell wind_x, wind_y, ethanol_ppm, pressure"
    assert found[1:3] == [f"outcomes.{key}: probes do not tell '{name}'; {told}" for key, name in
                          (("b", "wind_z"), ("c", "temperature"))]  # fmt: skip
    assert found[3].startswith("outcomes.d: probes.wind_x is no path of a probe")


def test_an_outcome_of_some_points_alone_can_be(tmp_path):
    maps = {"variants": {"none": {"maps": []}, "gmrf": {"maps": [{"kind": "gmrf"}]}}}
    assert load_plan(write(tmp_path, axes={"maps": maps}, outcomes={"c": "maps.0.correlation"}))


def test_a_fault_of_many_points_is_told_once_with_the_values_that_have_it(tmp_path):
    place = {"key": "gas.sources.0.position", "values": [[0.3, 0.5], [5, 0.5]]}
    ceiling = {"key": "robots.0.reach", "values": [0.1, 0.2, 0.3]}
    (line,) = faults(write(tmp_path, axes={"speed": SPEED, "place": place, "reach": ceiling}))
    assert line.startswith("axes.place: [5, 0.5] (6 points): gas.sources[0].position: x = 5 m is outside")
    slow = {"key": "wind.openings.0.speed", "low": 0.1, "high": 0.3}
    room = ROOM | {"obstacles": [{"kind": "box", "center": [0.3, 0.5], "size": [0.3, 0.3]}]}
    sampling = {"kind": "sobol", "count": 8}
    (line,) = faults(write(tmp_path, room, axes={"speed": slow}, sampling=sampling))
    assert line.startswith("axes.speed: 0.")
    assert " and 5 more (8 points): gas.sources[0].position: (0.3, 0.5) m is inside obstacles[0]" in line


def test_what_is_wrong_with_the_base_is_told_as_such(tmp_path):
    bad = ROOM | {"duration": "4 kg"}
    (line,) = faults(write(tmp_path, bad))
    assert line.startswith("room.yaml: duration: got '4 kg'")
    repaired = {"key": "duration", "values": [4, "5 s"]}
    assert load_plan(write(tmp_path, bad, axes={"duration": repaired}))
    inside = ROOM | {"robots": [ROOM["robots"][0] | {"arena": 3}]}
    (line,) = faults(write(tmp_path, inside))
    assert line.startswith("room.yaml: robots[0]: unknown key 'arena'")
