"""Policies as ONNX files: ours out, and those in that were trained elsewhere on Ballbot's environments.

A file has one input, observations (N, size), and one output, actions (N, n): each wheel's torque over the limit, as the
contract has them. What is read must be three layers with tanh between: `Gemm`, or `MatMul` and `Add`, then `Tanh`.
Whatever limits the action comes last (`Clip`), since a policy's torques are limited anyhow. It needs the extra `onnx`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.policy import Policy
from ballbot.errors import InputError, missing_package
from ballbot.files import read_bytes, write_bytes
from ballbot.learning.contract import Contract

try:
    import onnx
    from onnx import TensorProto, helper, numpy_helper
except ImportError:
    raise missing_package("A policy as an ONNX file", "onnx", extra="onnx") from None

#: of the operators, with what every runtime of today reads
_OPSET, _IR = 17, 9

Matrix = NDArray[np.float64]


def write_onnx(policy: Policy, path: str | Path) -> None:
    """Write a policy; its output is the torque over the limit, within -1 and 1.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> layers = {"first": np.zeros((4, 20)), "second": np.zeros((4, 5)), "last": np.ones((3, 5))}
    >>> numbers = {"torque_scale": 3.0, "torque_limit": 6.0, "period": 0.01, "largest_lean": 0.3, "largest_speed": 2.0}
    >>> policy = Policy(feedback=0.0, **numbers, **layers)
    >>> with TemporaryDirectory() as folder:
    ...     write_onnx(policy, f"{folder}/policy.onnx")
    ...     read_onnx(f"{folder}/policy.onnx", like=policy).last[0].tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0]
    """
    scale = policy.torque_scale / policy.torque_limit
    layers = (policy.first, policy.second, scale * policy.last)
    nodes, tensors, before = [], [], "observation"
    for k, layer in enumerate(layers, start=1):
        tensors += [_tensor(f"weights_{k}", layer[:, :-1]), _tensor(f"bias_{k}", layer[:, -1])]
        sums = f"sums_{k}"
        nodes.append(helper.make_node("Gemm", [before, f"weights_{k}", f"bias_{k}"], [sums], transB=1))
        before = f"units_{k}"
        if k < len(layers):
            nodes.append(helper.make_node("Tanh", [sums], [before]))
        else:
            tensors += [_tensor("least", np.array(-1.0)), _tensor("most", np.array(1.0))]
            nodes.append(helper.make_node("Clip", [sums, "least", "most"], ["action"]))
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["robots", size])
        for name, size in (("observation", policy.first.shape[1] - 1), ("action", len(policy.last)))
    ]
    graph = helper.make_graph(nodes, "policy", ends[:1], ends[1:], initializer=tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], producer_name="ballbot")
    model.ir_version = _IR
    write_bytes(path, model.SerializeToString())


def _tensor(name: str, values: Matrix) -> onnx.TensorProto:
    return numpy_helper.from_array(np.asarray(values, dtype=np.float32), name)


def read_onnx(path: str | Path, *, like: Policy) -> Policy:
    """Return the policy in a file; period, torque limit and trained range are those of `like`.

    InputError if the file is no ONNX model, or no network as the module describes, for the same robot; or a file
    contract.json beside it states another contract than that of `like`, or that the true state was observed.
    """
    try:
        model = onnx.load_model_from_string(read_bytes(path))
        onnx.checker.check_model(model)
    except InputError:
        raise
    except Exception as error:  # of protobuf or of the checker, which have many kinds
        raise InputError(f"{path} is no ONNX model: {str(error).splitlines()[0]}") from None
    layers = list(_layers(model, path))
    if len(layers) != 3:
        raise InputError(f"{path} has {len(layers)} layers; a policy has three, with tanh between.")
    first, second, last = layers
    beside = Path(path).with_name("contract.json")
    if beside.exists():
        its = Contract.read(beside)
        own = Contract.of(
            its.robot,
            wheels=len(like.last),
            torque_limit=like.torque_limit,
            period=like.period,
            delay=its.delay,
        )
        replace(own, added_to=its.added_to).require(its, of=str(path))
    shapes = [layer.shape[1] - 1 for layer in layers] + [len(last)]
    wanted = [like.first.shape[1] - 1, len(first), len(second), len(like.last)]
    if shapes != wanted or len(first) != len(second):
        raise InputError(
            f"{path} has layers of {shapes[0]}, {len(first)}, {len(second)} and {shapes[-1]} numbers; a policy of this "
            f"robot observes {wanted[0]}, has two hidden layers of one size, and decides {wanted[-1]} torques."
        )
    return Policy(
        feedback=like.feedback,
        torque_scale=like.torque_limit,
        torque_limit=like.torque_limit,
        period=like.period,
        largest_lean=like.largest_lean,
        largest_speed=like.largest_speed,
        first=first,
        second=second,
        last=last,
    )


def _layers(model: onnx.ModelProto, path: str | Path) -> Iterator[Matrix]:
    """Yield each layer (units, inputs + 1), the bias in the last column; refuse other networks."""
    known = {
        entry.name: np.asarray(numpy_helper.to_array(entry), np.float64) for entry in model.graph.initializer
    }
    pending, curved = None, True
    for node in model.graph.node:
        place = f"{path}: the operator {node.op_type}"
        if node.op_type in ("Gemm", "MatMul"):
            if not curved:
                raise InputError(f"{place} follows a layer without Tanh between.")
            if pending is not None:
                yield pending
            pending, curved = _layer(node, known, place), False
        elif node.op_type == "Add" and pending is not None and not curved:
            bias = [known[name] for name in node.input if name in known]
            if len(bias) != 1:
                raise InputError(f"{place} adds no constant bias.")
            pending[:, -1] += bias[0].ravel()
        elif node.op_type == "Tanh" and pending is not None:
            curved = True
        elif node.op_type not in ("Identity", "Flatten", "Cast", "Clip", "Constant"):
            raise InputError(
                f"{place} is not supported; a policy consists of Gemm or MatMul, Add, Tanh and Clip."
            )
    if pending is not None:
        if curved:
            raise InputError(f"{path}: Tanh stands after the last layer; Clip may.")
        yield pending


def _layer(node: onnx.NodeProto, known: Mapping[str, Matrix], place: str) -> Matrix:
    options = {entry.name: helper.get_attribute_value(entry) for entry in node.attribute}
    if node.input[1] not in known or options.get("transA") or options.get("alpha", 1.0) != 1.0:
        raise InputError(f"{place} does not multiply by constant weights.")
    weights = known[node.input[1]]
    weights = weights if options.get("transB") else weights.T
    bias = np.zeros(len(weights))
    if len(node.input) > 2:
        if node.input[2] not in known or options.get("beta", 1.0) != 1.0:
            raise InputError(f"{place} adds no constant bias.")
        bias = known[node.input[2]].ravel()
    return np.column_stack([weights, bias])
