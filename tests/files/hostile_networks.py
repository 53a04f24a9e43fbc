"""Small ONNX files that take for ever, fill the memory, or reach for other files."""

from pathlib import Path
from typing import Any

import numpy as np
from onnx import ModelProto, TensorProto, helper, numpy_helper

OPSET = [helper.make_opsetid("", 17)]


def model(nodes: list[Any], given: list[Any] = (), functions: list[Any] = ()) -> ModelProto:  # type: ignore[assignment]
    """A network from "observation" (rows, 7) to "action" (rows, 2)."""
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["rows", size])
        for name, size in (("observation", 7), ("action", 2))
    ]
    graph = helper.make_graph(nodes, "policy", ends[:1], ends[1:], [weights(), *given])
    opset = [*OPSET, helper.make_opsetid("own", 1)] if functions else OPSET
    return helper.make_model(graph, opset_imports=opset, ir_version=8, functions=list(functions))


def weights() -> TensorProto:
    """The matrix of `model`."""
    return numpy_helper.from_array(np.ones((7, 2), np.float32), "w")


def constant(name: str, value: Any) -> TensorProto:
    """A tensor of whole numbers or booleans."""
    return numpy_helper.from_array(np.asarray(value), name)


def action(source: str) -> list[Any]:
    """Nodes from (rows, 7) to the action."""
    return [helper.make_node("MatMul", [source, "w"], ["action"])]


def plain() -> ModelProto:
    """A network that is none of these."""
    return model(action("observation"))


def endless() -> ModelProto:
    """A loop of 2^62 rounds over the observation."""
    state = [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in ("in", "out")]
    go_on = [helper.make_tensor_value_info(name, TensorProto.BOOL, []) for name in ("go_in", "go_out")]
    count = helper.make_tensor_value_info("n", TensorProto.INT64, [])
    body = helper.make_graph(
        [helper.make_node("Sin", ["in"], ["out"]), helper.make_node("Identity", ["go_in"], ["go_out"])],
        "body",
        [count, go_on[0], state[0]],
        [go_on[1], state[1]],
    )
    loop = helper.make_node("Loop", ["rounds", "yes", "observation"], ["looped"], body=body)
    return model(
        [loop, *action("looped")], [constant("rounds", np.int64(2**62)), constant("yes", np.bool_(True))]
    )


def large(size: int = 2**36) -> ModelProto:
    """A constant of 64 GB x 4, made when it is loaded or evaluated."""
    nodes = [
        helper.make_node("ConstantOfShape", ["shape"], ["big"]),
        helper.make_node("ReduceSum", ["big"], ["sum"], keepdims=0),
        helper.make_node("Add", ["observation", "sum"], ["moved"]),
    ]
    return model([*nodes, *action("moved")], [constant("shape", np.array([size], np.int64))])


def large_evaluated() -> ModelProto:
    """The observation tiled to 2^36 rows."""
    nodes = [
        helper.make_node("Tile", ["observation", "times"], ["big"]),
        helper.make_node("ReduceMean", ["big"], ["mean"], axes=[0]),
        helper.make_node("Add", ["observation", "mean"], ["moved"]),
    ]
    return model([*nodes, *action("moved")], [constant("times", np.array([2**36, 1], np.int64))])


def nested_functions(levels: int = 40) -> ModelProto:
    """Functions that call the one below twice: 2^levels nodes once they are inlined."""
    own = [*OPSET, helper.make_opsetid("own", 1)]
    functions = []
    for n in range(levels):
        below, domain = (f"f{n - 1}", "own") if n else ("Sin", "")
        nodes = [
            helper.make_node(below, ["x"], ["m"], domain=domain),
            helper.make_node(below, ["m"], ["y"], domain=domain),
        ]
        functions.append(helper.make_function("own", f"f{n}", ["x"], ["y"], nodes, own))
    call = helper.make_node(f"f{levels - 1}", ["observation"], ["called"], domain="own")
    return model([call, *action("called")], functions=functions)


def external(location: str) -> ModelProto:
    """Weights that lie in another file."""
    made = plain()
    (w,) = made.graph.initializer
    w.ClearField("raw_data")
    w.data_location = TensorProto.EXTERNAL
    w.external_data.add(key="location", value=location)
    return made


def save(made: ModelProto, path: Path) -> Path:
    """Write a model."""
    path.write_bytes(made.SerializeToString())
    return path
