"""Policies as ONNX files, against ONNX's own evaluator."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.errors import InputError
from tests.support.control_examples import alten, with_policy

onnx = pytest.importorskip("onnx")

from onnx import TensorProto, helper, numpy_helper  # noqa: E402
from onnx.reference import ReferenceEvaluator  # noqa: E402

from ballbot.control.presets import nominal_controller  # noqa: E402
from ballbot.learning.contract import Contract  # noqa: E402
from ballbot.learning.onnx import read_onnx, write_onnx  # noqa: E402

POLICY = with_policy(nominal_controller(alten())).parts.policy


def test_written_policy_gives_the_torques_over_the_limit(tmp_path):
    seen = np.random.default_rng(1).normal(0.0, 1.0, (50, 19)).astype(np.float32)
    write_onnx(POLICY, tmp_path / "policy.onnx")
    (found,) = ReferenceEvaluator(str(tmp_path / "policy.onnx")).run(None, {"observation": seen})
    wanted = POLICY.torque_scale / POLICY.torque_limit * outputs(POLICY, seen)
    assert np.abs(wanted).max() > 1.0  # some are limited
    np.testing.assert_allclose(found, np.clip(wanted, -1.0, 1.0), atol=1e-5)  # in single precision


def test_policy_that_was_written_is_read_as_the_same_network(tmp_path):
    write_onnx(POLICY, tmp_path / "policy.onnx")
    read = read_onnx(tmp_path / "policy.onnx", like=POLICY)
    np.testing.assert_array_equal(read.second, POLICY.second)
    np.testing.assert_allclose(read.torque_scale * read.last, POLICY.torque_scale * POLICY.last, rtol=1e-6)


def foreign(path, operators, units=8):
    """Write a network as another framework does: products and sums apart."""
    random, nodes, tensors, before, size = np.random.default_rng(2), [], [], "seen", 19
    for k, operator in enumerate(operators):
        out, inputs = f"v{k}", [before]
        if operator in ("MatMul", "Add"):
            if operator == "MatMul":
                wide = 3 if "MatMul" not in operators[k + 1 :] else units
                values, size = random.normal(size=(size, wide)), wide
            else:
                values = random.normal(size=size)
            tensors.append(numpy_helper.from_array(values.astype(np.float32), f"w{k}"))
            inputs.append(f"w{k}")
        nodes.append(helper.make_node(operator, inputs, [out]))
        before = out
    given, found = (
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["N", wide])]
        for name, wide in (("seen", 19), (before, 3))
    )
    graph = helper.make_graph(nodes, "net", given, found, initializer=tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    path.write_bytes(model.SerializeToString())


def outputs(policy, seen):
    """Return what the last layer of a policy's network gives (N, 3)."""
    x = seen.astype(np.float64)
    for layer in (policy.first, policy.second):
        x = np.tanh(x @ layer[:, :-1].T + layer[:, -1])
    return x @ policy.last[:, :-1].T + policy.last[:, -1]


LAYER = ["MatMul", "Add"]


def test_policy_trained_elsewhere_is_read(tmp_path):
    path = tmp_path / "foreign.onnx"
    foreign(path, [*LAYER, "Tanh", *LAYER, "Tanh", *LAYER])
    read, seen = (
        read_onnx(path, like=POLICY),
        np.random.default_rng(3).normal(size=(20, 19)).astype(np.float32),
    )
    (wanted,) = ReferenceEvaluator(str(path)).run(None, {"seen": seen})
    np.testing.assert_allclose(outputs(read, seen), wanted, atol=1e-5)
    assert read.torque_scale == POLICY.torque_limit


@pytest.mark.parametrize(
    ("operators", "named"), [([*LAYER, "Relu", *LAYER, "Tanh", *LAYER], "Relu"), ([*LAYER, "Tanh", *LAYER], "2 layers"),
                             ([*LAYER, *LAYER, "Tanh", *LAYER], "without Tanh"),
                             ([*LAYER, "Tanh", *LAYER, "Tanh", *LAYER, "Tanh"], "after the last")],
)  # fmt: skip
def test_other_networks_are_refused(tmp_path, operators, named):
    path = tmp_path / "foreign.onnx"
    foreign(path, operators)
    with pytest.raises(InputError, match=named):
        read_onnx(path, like=POLICY)


def test_network_of_another_robot_and_no_network_are_refused(tmp_path):
    path = tmp_path / "policy.onnx"
    write_onnx(POLICY, path)
    four = replace(POLICY, first=np.zeros((8, 23)), second=np.zeros((8, 9)), last=np.zeros((4, 9)))
    with pytest.raises(InputError, match="decides 4 torques"):
        read_onnx(path, like=four)
    path.write_text("no network")
    with pytest.raises(InputError, match="no ONNX model"):
        read_onnx(path, like=POLICY)


def test_contract_beside_a_network_is_required(tmp_path):
    path = tmp_path / "policy.onnx"
    write_onnx(POLICY, path)
    its = Contract.of("alten", wheels=3, torque_limit=POLICY.torque_limit, period=POLICY.period, delay=1)
    its.write(tmp_path / "contract.json")
    read_onnx(path, like=POLICY)
    for change, named in (
        ({"period": 0.02}, "period is 0.02"),
        ({"observed": "state"}, "observed is 'state'"),
    ):
        replace(its, **change).write(tmp_path / "contract.json")
        with pytest.raises(InputError, match=named):
            read_onnx(path, like=POLICY)
