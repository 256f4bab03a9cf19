"""The same equations compiled for a GPU: to its assembly anywhere, and run where there is one."""

from types import SimpleNamespace

import numpy as np
import pytest

from ballbot import InputError, Model, Robot

pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: pip install 'ballbot[gpu]'")

from numba import cuda, typeof, types

from ballbot.mechanics.engine.cuda import _advance, packed_in_lanes, simulate_on_gpu
from ballbot.mechanics.engine.run import Lanes, simulate_lanes


@pytest.mark.sample
def test_the_engine_compiles_for_a_gpu(monkeypatch):
    """One source for all targets: the kernel becomes PTX for a Hopper chip, without a call left in it."""
    import numba.cuda.dispatcher as dispatcher

    hopper = (9, 0)
    monkeypatch.setattr(
        dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=hopper), raising=False
    )
    selected, table, numbers = (
        typeof(Model(Robot.load("alten")).selected),
        types.float64[:, ::1],
        types.int64[::1],
    )
    signature = (selected, table, table, table, types.float64, types.int64, numbers)
    try:
        assembly, _ = cuda.compile_ptx(_advance.py_func, signature, cc=hopper)
    except Exception as error:
        if "NVVM" in str(error) or "nvvm" in str(error):
            pytest.skip(f"NVVM is not installed: {error}")
        raise
    assert ".target sm_90" in assembly
    assert assembly.count("fma.rn.f64") > 1000
    assert "call" not in assembly


def test_lanes_lie_side_by_side():
    rows = np.arange(40.0 * 7).reshape(40, 7)
    packed = packed_in_lanes(rows, 40).reshape(2, 7, 32)
    assert (packed[0, :, 5] == rows[5]).all()
    assert (packed[1, :, 3] == rows[35]).all()


@pytest.mark.skipif(cuda.is_available(), reason="there is a GPU")
def test_missing_gpu_raises_a_clear_error():
    model = Model(Robot.load("alten"))
    with pytest.raises(InputError, match="No CUDA device"):
        simulate_on_gpu(
            model.selected,
            parameters=model.packed[None],
            initial=np.zeros((1, 10)),
            torques=np.zeros((1, 3)),
            sample_time=0.005,
            steps=5,
        )


@pytest.mark.skipif(not cuda.is_available(), reason="no GPU here")
def test_the_gpu_gives_the_processors_numbers():
    model = Model(Robot.load("alten"))
    initial = 0.02 * np.random.default_rng(0).standard_normal((100, 10))
    torques = 0.2 * np.random.default_rng(1).standard_normal((40, 3))
    times = {"sample_time": 0.005, "steps": 5}
    there = simulate_on_gpu(
        model.selected, parameters=model.packed[None], initial=initial, torques=torques, **times
    ).finals
    lanes = Lanes(parameters=model.packed[None], initial=initial, torques=torques[None])
    here = simulate_lanes(model.selected, lanes, **times).states[:, -1]
    # rounding differs where multiplications are fused; 200 steps of an unstable robot amplify it e times or so
    np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-11)
