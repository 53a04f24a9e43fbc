"""Readings without calibration, ratios and ranks, and classifiers of the gas by an array of metal oxides."""

import numpy as np
import pytest
from robots import Bench

import taichi_plume as tp
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.files.gas_classes import NearestGases
from taichi_plume.scenario.loading import ScenarioError

pytestmark = pytest.mark.usefixtures("taichi")

MOX = {"kind": "mox", "model": "tgs2620", "spread": 1.0, "noise": 0.004}
LEVELS = np.concatenate([np.zeros(40), np.full(60, 80.0), np.zeros(90), np.full(60, 20.0)])
MODELS = ("tgs2600", "mics5524", "tgs2611", "tgs2612")  # two respond to ethanol, two to methane
GASES = ("ethanol", "methane")


def room(classifier=None, models=MODELS, **sensor):
    """A room with ethanol on the left and methane on the right, and a robot in each."""
    array = [{"kind": "mox", "model": model, "spread": 1.0} | sensor for model in models]
    sensors = {"gas": array, **({"classifier": classifier} if classifier else {})}
    parts = [
        {"kind": "eulerian", "species": gas, "sources": [{"position": [x, 1], "rate": rate}]}
        for gas, x, rate in zip(GASES, (0.5, 2.5), ("40 mg/s", "150 mg/s"), strict=True)
    ]
    start = {"kind": "positions", "positions": [[0.6, 1.0], [2.4, 1.0]]}
    algorithm = {"kind": "random_walk", "speed": 0}
    return {
        "duration": 20,
        "domain": {"size": [3, 2], "spacing": 0.1},
        "wind": {"kind": "synthetic", "speed": 0.02},
        "gas": {"kind": "mixture", "parts": parts},
        "robots": [{"count": 2, "start": start, "algorithm": algorithm, "sensors": sensors, "reach": 0.01}],
    }


def test_ratios_and_ranks_of_recorded_resistances():
    """Both follow from the resistances by NumPy, for two units that differ in R_air; clean air has neither."""
    sensors = [MOX | {"gives": gives, "memory": 15.0} for gives in ("ratio", "rank", "ratio", "rank", "ppm")]
    readings, resistance = (
        Bench(*sensors).series(LEVELS, name).astype(float) for name in ("reading_ppm", "resistance_ohm")
    )
    assert np.ptp(np.log(resistance[0])) > 0.3  # the units differ
    cleanest = np.maximum.accumulate(resistance, axis=0)
    np.testing.assert_allclose(readings[:, [0, 2]], (cleanest / resistance - 1.0)[:, [0, 2]], atol=2e-5)
    level = np.log(resistance)
    for n in (1, 3):  # 15 s are 150 readings: all of the 256 stored ones
        wanted = [np.mean(level[:k, n] - level[k, n] > 0.02) if k else 0.0 for k in range(len(LEVELS))]
        np.testing.assert_allclose(readings[:, n], wanted, atol=0.02)
    assert readings[:35, [1, 3]].max() == 0.0  # noise alone
    assert readings[60:95, [1, 3]].min() > 0.4
    assert (readings[:, 4] != readings[:, 0]).any()


def test_ranks_are_no_concentrations():
    """Algorithms that need a concentration refuse ranks, and take ratios."""
    for algorithm in ({"kind": "source_term"}, {"kind": "infotaxis", "lag": "deconvolved"}):
        scenario = room(gives="rank")
        scenario["robots"][0]["algorithm"] = algorithm
        with pytest.raises(ScenarioError, match=r"robots\[0\].sensors.gas.gives: a rank .*use ppm or ratio"):
            load_scenario(scenario)
    scenario["robots"][0]["sensors"]["gas"][0]["gives"] = "ratio"
    load_scenario(scenario)


def test_nearest_neighbours_by_brute_force():
    """Votes of the k unit vectors at the least distance; the length of a response does not count."""
    rng = np.random.default_rng(5)
    table, asked = rng.random((40, 3)) + 0.1, rng.random((15, 3)) + 0.1
    labels = np.array(["b", "a", "c", "a"] * 10)
    found = NearestGases(labels, table, 7)
    units, of = (x / np.linalg.norm(x, axis=1)[:, None] for x in (table, asked))
    nearest = np.argsort(np.linalg.norm(of[:, None] - units, axis=-1), axis=1)[:, :7]
    wanted = np.stack([(labels[nearest] == name).mean(axis=1) for name in found.classes], axis=1)
    assert found.classes == ("a", "b", "c")
    np.testing.assert_allclose(found.probabilities(asked), wanted)
    np.testing.assert_allclose(found.probabilities(3.0 * asked), wanted)


def table_of(path, models=4, rows=(("ethanol", 0.3), ("methane", 0.6), ("air", 1.0))):
    """Ratios R/R0: by ethanol the first two sensors respond, by methane the last two."""
    lines = [f"gas,{','.join(f's{k}' for k in range(models))}"]
    for gas, value in rows:
        feels = {"ethanol": (0, 1), "methane": (2, 3), "air": ()}[gas]
        for level in (value, value**0.7, value**0.5):
            lines.append(f"{gas},{','.join(str(level if k in feels else 1.0) for k in range(models))}")
    path.write_text("\n".join(lines))


def network(path, inputs=4, outputs=2, kinds=1):
    """Softmax of the first two responses less the last two, times 20."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    from onnx import TensorProto, helper, numpy_helper

    weights = np.zeros((inputs, outputs), np.float32)
    weights[:2, 0] = weights[2:, 1] = 20.0
    nodes = [helper.make_node("MatMul", ["x", "w"], ["y"]), helper.make_node("Softmax", ["y"], ["p"], axis=1)]
    ends = [helper.make_tensor_value_info("x", TensorProto.FLOAT, ["rows", inputs])]
    ends += [helper.make_tensor_value_info("other", TensorProto.FLOAT, ["rows", 1])] * (kinds - 1)
    out = [helper.make_tensor_value_info("p", TensorProto.FLOAT, ["rows", outputs])]
    graph = helper.make_graph(nodes, "g", ends, out, [numpy_helper.from_array(weights, "w")])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path)


@pytest.mark.parametrize("kind", ["curves", "probability", "onnx"])
def test_a_robot_reads_the_gas_that_it_follows(kind, tmp_path):
    """Both robots measure gas. Algorithms get that of ethanol alone, times the share of the reading before."""
    classifier = {"kind": "nearest", "follows": "ethanol"}
    if kind == "probability":
        classifier["by"] = "probability"
    elif kind == "onnx":
        network(tmp_path / "net.onnx")
        classifier = {
            "kind": "onnx",
            "file": "net.onnx",
            "classes": ["ethanol", "methane"],
            "follows": "ethanol",
        }
    run = tp.simulate(
        load_scenario(room(classifier), folder=tmp_path), out=tmp_path / "run", recording=False, report=False
    )
    table = run.robots
    parts = [table[table.robot == n] for n in (0, 1)]
    for part in parts:
        share = np.concatenate([[0.0], part.gas_share[:-1]])
        np.testing.assert_allclose(part.above_ppm, part.reading_ppm * share, rtol=1e-6)
        assert part.reading_ppm.iloc[-1] > 1.0
        np.testing.assert_array_equal(part.above_1_ppm, part.reading_1_ppm)  # the first sensor alone
    assert parts[0].gas_share.iloc[-50:].min() > 0.5
    assert parts[1].gas_share.iloc[-50:].max() < 0.5
    assert parts[0].gas_share.iloc[0] == 0.0  # in clean air


def test_readings_as_before_without_a_classifier(tmp_path):
    run = tp.simulate(room(), out=tmp_path / "run", recording=False, report=False)
    assert not {"gas_share", "above_ppm"} & set(run.robots)


@pytest.mark.parametrize(
    ("classifier", "models", "says"),
    [
        ({"follows": "propane"}, MODELS, ("follows: 'propane'", "ethanol, methane")),
        ({"follows": "ethanol"}, MODELS[:1], ("kind: needs two or more", "a single one")),
        ({"file": "three.csv", "follows": "ethanol"}, MODELS, ("file:", "of 3 sensors; wanted 4")),
        ({"file": "one.csv", "follows": "ethanol"}, MODELS, ("file:", "only ethanol")),
        ({"file": "no.csv", "follows": "ethanol"}, MODELS, ("file:", "no column 'gas'", "a, b")),
        ({"file": "zero.npz", "follows": "ethanol"}, MODELS, ("file:", "[1, 2] is 0")),
        ({"file": "shape.npz", "follows": "ethanol"}, MODELS, ("file:", "(3,) and (2, 4)")),
        ({"file": "half.npz", "follows": "ethanol"}, MODELS, ("file:", "lacks the array 'responses'")),
        ({"file": "none.csv", "follows": "ethanol"}, MODELS, ("file:", "none.csv")),
    ],
)
def test_bad_tables(classifier, models, says, tmp_path):
    table_of(tmp_path / "three.csv", 3)
    table_of(tmp_path / "one.csv", rows=(("ethanol", 0.3), ("air", 1.0)))
    (tmp_path / "no.csv").write_text("a,b\n1,2")
    names, ones = np.array(["ethanol", "methane"]), np.ones((2, 4))
    np.savez(tmp_path / "zero.npz", gas=names, responses=np.where(np.arange(8).reshape(2, 4) == 6, 0.0, ones))
    np.savez(tmp_path / "shape.npz", gas=np.array(["a", "b", "c"]), responses=ones)
    np.savez(tmp_path / "half.npz", gas=names)
    refused(room({"kind": "nearest"} | classifier, models), says, tmp_path)


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        ({"inputs": 3}, ("file:", "has 3 inputs; wanted 4")),
        ({"outputs": 3}, ("file:", "has 3 outputs; wanted 2")),
        ({"kinds": 2}, ("file:", "takes 2 inputs")),
    ],
)
def test_networks_of_wrong_shape(shape, says, tmp_path):
    network(tmp_path / "net.onnx", **shape)
    classifier = {"kind": "onnx", "file": "net.onnx", "classes": list(GASES), "follows": "ethanol"}
    refused(room(classifier), says, tmp_path)


def refused(scenario, says, folder):
    """One line names the classifier's key and what was found."""
    with pytest.raises(ScenarioError) as caught:
        load_scenario(scenario, folder=folder)
    (line,) = caught.value.faults
    assert line.startswith("robots[0].sensors.classifier.")
    assert all(part in line for part in says), line
    assert "\n" not in line


def test_a_table_of_ratios(tmp_path):
    """A CSV file and the arrays of a .npz file train equal classifiers; the row of clean air is left out."""
    table_of(tmp_path / "table.csv")
    lines = [line.split(",") for line in (tmp_path / "table.csv").read_text().splitlines()[1:]]
    values = 5e4 * np.array([[float(cell) for cell in line[1:]] for line in lines])  # resistances of one unit
    np.savez(tmp_path / "table.npz", gas=np.array([line[0] for line in lines]), responses=values)
    shares = []
    for name in ("table.csv", "table.npz"):
        classifier = {"kind": "nearest", "file": name, "follows": "methane", "neighbours": 1}
        scenario = load_scenario(room(classifier), folder=tmp_path)
        run = tp.simulate(scenario, out=tmp_path / f"run_{name}", recording=False, report=False)
        last = run.robots.groupby("robot").gas_share.last()
        shares.append(last.tolist())
    assert shares == [[0.0, 1.0]] * 2
