"""Walk every public function that hands arrays to compiled code, with arrays of every wrong and odd kind.

Run by test_memory.py in a process of its own, with Numba's bounds check. Each case is a public function with clean
arrays; each array is replaced in turn by a variant. A variant that means the same numbers must give the clean answer,
or be refused; any other must be refused, in one sentence. What else happens (an index out of bounds above all) is a
failure.
"""

import importlib
import json
import pkgutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass

import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher

import ballbot
from ballbot import Controller, InputError, Log, Model, Robot, simulate, simulate_batch
from ballbot.control.presets import nominal_controller
from ballbot.control.references import hold
from ballbot.control.safety import SafeController
from ballbot.estimation import Fix, OnboardState, Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.swing import Swing
from ballbot.identification.swing import _sensed as swing_motion
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.mechanics.friction_laws import Classical
from ballbot.mechanics.stick_slip import minimise
from ballbot.robot import Friction
from ballbot.simulation.batch import Verdict
from ballbot.simulation.driveline import Driveline, simulate_driveline
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.simulation.upside_down import ClampedBall, simulate_balls
from ballbot.twin import Twin

FRICTION = Friction(
    viscous=(0.014, 0.016, 0.013),
    coulomb=(0.11, 0.09, 0.12),
    stribeck=(0.05, 0.04, 0.06),
    stribeck_speed=0.6,
    stribeck_exponent=1.1,
    rolling=0.007,
)
ROBOT = Robot.load("alten").replace(friction=FRICTION)
MODEL, H, TWIN = Model(ROBOT), 0.005, Twin(ROBOT)
SENSED = SensedPlant(MODEL, Imperfections(sensors=ROBOT.sensors, backlash=0.02, slope=(0.02, 0.01)))
CONTROLLER = nominal_controller(ROBOT)
BALL = ClampedBall.of_robot(ROBOT)
CURVE = {"viscous": 0.01, "coulomb": 0.1, "stribeck": 0.05, "stribeck_speed": 0.6}
STATE = 0.05 * np.sin(1.0 + np.arange(10.0))
TORQUES = np.array([0.125, -0.0625, 0.25])
Arrays = dict[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Case:
    """One call of a public function."""

    call: Callable[[Arrays], object]
    arrays: Arrays
    missing: bool = False  #: whether a value that is no number is a measurement that is missing
    unbounded: tuple[str, ...] = ()  #: arrays in which an infinite number has a meaning
    rows: tuple[str, ...] = ()  #: arrays of which another number of rows, or more dimensions, is welcome
    lengths: tuple[str, ...] = ()  #: arrays of any length above zero
    optional: tuple[str, ...] = ()  #: arrays that may be None


def cases() -> Iterator[tuple[str, Case]]:
    """Yield every case by the name of its function."""
    q, q_dot = np.array([STATE[:5], 0.5 * STATE[:5]]), np.array([STATE[5:], STATE[:5]])
    u = np.array([TORQUES, -TORQUES])
    both = ("q", "q_dot", "u")
    for name in ("mass_matrix", "wheel_jacobian"):
        yield (
            f"Model.{name}",
            Case(call=lambda a, f=name: getattr(MODEL, f)(a["q"]), arrays={"q": q}, rows=both),
        )
    for name in ("wheel_speed", "energy"):
        call = lambda a, f=name: getattr(MODEL, f)(a["q"], a["q_dot"])  # noqa: E731
        yield f"Model.{name}", Case(call=call, arrays={"q": q, "q_dot": q_dot}, rows=both)
    for name in ("acceleration", "normal_force"):
        call = lambda a, f=name: getattr(MODEL, f)(a["q"], a["q_dot"], a["u"])  # noqa: E731
        yield f"Model.{name}", Case(call=call, arrays={"q": q, "q_dot": q_dot, "u": u}, rows=both)
    yield (
        "Model.advance",
        Case(call=lambda a: MODEL.advance(a["x"], a["u"], H), arrays={"x": STATE, "u": TORQUES}),
    )
    yield (
        "simulate_lanes",
        Case(
            call=lambda a: simulate_lanes(MODEL.selected, Lanes(**a), sample_time=H, steps=2),
            arrays={
                "parameters": np.array([MODEL.packed] * 2),
                "initial": np.array([STATE, 0.5 * STATE]),
                "torques": np.array([[TORQUES] * 3] * 2),
                "torque_of": np.array([1, 0]),
                "parameter_of": np.array([0, 1]),
                "initial_of": np.array([0, 1]),
            },
            rows=("parameters", "initial", "torques"),
            optional=("torque_of", "parameter_of", "initial_of"),
        ),
    )
    yield "minimise", _minimise()
    yield from _control()
    yield from _estimators()
    yield from _plants()
    yield from _simulations()
    yield from _drivelines()
    yield from _clamped_ball()
    yield "Log", _log()
    yield from _identification()


def _minimise() -> Case:
    C = np.arange(15.0).reshape(3, 5) / 8.0 - 1.0
    arrays = {
        "M": np.diag(np.arange(1.0, 6.0)),
        "free": np.arange(5.0) / 4.0,
        "C": C,
        "limits": np.array([0.5, 0.25, 1.0]),
    }
    return Case(call=lambda a: minimise(rolling_force=0.1, h=0.001, **a), arrays=arrays, rows=("C",))


def _control() -> Iterator[tuple[str, Case]]:
    def update(a: Arrays) -> object:
        CONTROLLER.reset()
        return CONTROLLER.update(0.0, a["state"], a["reference"])

    def safe(a: Arrays) -> object:
        one = SafeController(CONTROLLER, ROBOT)
        one.reset()
        return one.update(0.0, a["state"], np.zeros(10))

    reference = np.zeros(10)
    reference[[0, 1, 4]] = 0.5, -0.25, 0.125
    yield (
        "Controller",
        Case(call=lambda a: Controller(ROBOT, a["gain"]).gain, arrays={"gain": CONTROLLER.gain}),
    )
    yield (
        "Controller.update",
        Case(call=lambda a: update(a | {"reference": reference}), arrays={"state": STATE}, missing=True),
    )
    yield (
        "Controller.update, reference",
        Case(call=lambda a: update(a | {"state": STATE}), arrays={"reference": reference}),
    )
    yield "SafeController.update", Case(call=safe, arrays={"state": STATE}, missing=True)


def _estimators() -> Iterator[tuple[str, Case]]:
    clean: Arrays = {
        "wheel_angles": np.array([0.5, 0.25, -0.125]),
        "wheel_speeds": np.array([0.5, 0.25, -0.125]),
        "gyro": np.array([0.03125, 0.0625, -0.03125]),
        "attitude": np.array([0.03125, -0.03125, 0.125]),
    }

    def run(estimator: KalmanFilter | OnboardState, a: Arrays) -> object:
        estimator.reset()
        estimator.update(Reading(**clean))
        estimator.update(Reading(**(clean | a)))
        return estimator.update(Reading(**clean, fix=Fix(position=np.zeros(2))))

    for estimator in (KalmanFilter(ROBOT, sample_time=H), OnboardState(ROBOT, sample_time=H)):
        name = f"{type(estimator).__name__}.update"
        yield name, Case(call=lambda a, e=estimator: run(e, a), arrays=clean, missing=True)
    yield (
        "Fix",
        Case(
            call=lambda a: Fix(**a).position,
            arrays={"position": np.array([0.5, 0.25])},
            missing=True,
            optional=("position",),
        ),
    )


class _Answering:
    sample_time = H

    def __init__(self, torques: np.ndarray) -> None:
        self.torques = torques

    def reset(self) -> None: ...

    def update(self, *_: object) -> np.ndarray:
        return self.torques


def _plants() -> Iterator[tuple[str, Case]]:
    plant = ModelPlant(MODEL)

    def step(a: Arrays) -> object:
        plant.reset(a.get("state", STATE))
        return plant.step(a.get("torques", TORQUES), H).state

    def twin(a: Arrays) -> object:
        TWIN.reset(a.get("state", STATE), seed=1)
        return TWIN.step(a.get("torques", TORQUES), H).state

    def sensed(a: Arrays) -> object:
        SENSED.reset(a.get("state", STATE), seed=1)
        return SENSED.step(a.get("torques", TORQUES), H).state

    yield (
        "ModelPlant",
        Case(call=step, arrays={"state": STATE, "torques": TORQUES}, rows=("state",), optional=("state",)),
    )
    yield "Twin", Case(call=twin, arrays={"state": STATE, "torques": TORQUES}, optional=("state",))
    yield (
        "SensedPlant",
        Case(call=sensed, arrays={"state": STATE, "torques": TORQUES}, rows=("state",), optional=("state",)),
    )


def _simulations() -> Iterator[tuple[str, Case]]:
    reference = hold(x=0.5)(0.0)
    run = {"duration": 3 * H}
    yield (
        "simulate",
        Case(
            call=lambda a: (
                simulate(MODEL, CONTROLLER, lambda _: a["wanted"], initial_state=a["start"], **run).states
            ),
            arrays={"wanted": reference, "start": STATE},
            rows=("start",),
            optional=("start",),
        ),
    )
    yield (
        "simulate, the controller's torques",
        Case(call=lambda a: simulate(MODEL, _Answering(a["u"]), hold(), **run).states, arrays={"u": TORQUES}),
    )
    verdict = np.eye(10)
    yield (
        "simulate_batch",
        Case(
            call=lambda a: simulate_batch(
                MODEL,
                CONTROLLER,
                lambda _: a["wanted"],
                initial_states=a["starts"],
                verdict=Verdict(settled=a["settled"], lost=1.0, grip=2.0),
                imperfections=[Imperfections(delay=1)],
                **run,
            ),
            arrays={"wanted": reference, "starts": np.array([STATE, 0.5 * STATE]), "settled": verdict},
            rows=("starts", "settled"),
            optional=("starts",),
            unbounded=("settled",),
        ),
    )


def _drivelines() -> Iterator[tuple[str, Case]]:
    line = Driveline(inertia=0.003, friction=Classical(**CURVE, stribeck_exponent=1.1))
    yield (
        "simulate_driveline",
        Case(
            call=lambda a: simulate_driveline(line, a["u"], sample_time=H, initial_speed=0.5),
            arrays={"u": np.array(TORQUES)},
            lengths=("u",),
        ),
    )


def _clamped_ball() -> Iterator[tuple[str, Case]]:
    yield (
        "simulate_balls",
        Case(
            call=lambda a: simulate_balls(BALL, frictions=[FRICTION], sample_time=H, **a),
            arrays={
                "initial": np.array([[0.5, 0.25, -0.5], [0.0, 0.125, 0.5]]),
                "torques": np.array([[TORQUES] * 3] * 2),
            },
            rows=("torques",),
        ),
    )
    yield (
        "ClampedBall",
        Case(call=lambda a: ClampedBall(**a), arrays={"A": BALL.A, "inertia": BALL.inertia}, rows=("A",)),
    )


def _log() -> Case:
    t = np.arange(4) * H
    return Case(call=lambda a: Log(a), arrays={"t": t, "x": t + 0.5}, missing=True)


def _identification() -> Iterator[tuple[str, Case]]:
    axis = Axis(values={"mass": 2.0, "viscous": 1.0, "coulomb": 0.5, "offset": 0.0})
    path = np.sin(np.arange(200.0) / 8.0)

    def moved(a: Arrays) -> object:
        record = AxisRecord(name="axis", sample_time=H, **a)
        starts = np.array([[0.0, 0.0], [0.1, 0.0]])
        return axis.windows(record.force, H, np.array([0, 100]), np.array([99, 99]), starts)

    yield "AxisRecord", Case(call=moved, arrays={"force": path, "position": path})
    t = np.arange(10) * H
    p = np.array([16.0, 0.1, 0.05, 0.2, 0.0, 0.0])  # what `fit_swing` estimates, without its iterations

    def swing(a: Arrays) -> object:
        one = Swing(kind="angle", period=np.pi / 2.0, source="made", **a)
        return np.array([*swing_motion(p, one, 10), one.values])

    yield "Swing", Case(call=swing, arrays={"t": t, "values": 0.2 * np.cos(4.0 * t)})


@dataclass(frozen=True)
class Variant:
    """An array in place of a clean one."""

    name: str
    value: object
    same: np.ndarray | None  #: the clean array that it means, or None if it means none


def variants(clean: np.ndarray, *, rows: bool) -> Iterator[Variant]:
    """Yield everything that the clean array is replaced by."""
    whole = clean.dtype.kind in "iu"
    for name, value in (
        ("list", clean.tolist()),
        ("tuple", tuple(clean.tolist())),
        ("Fortran order", np.asfortranarray(clean)),
        ("strided", np.repeat(clean, 2, axis=-1)[..., ::2]),
        ("reversed", clean[::-1].copy()[::-1]),
        ("other byte order", clean.astype(clean.dtype.newbyteorder())),
        ("unaligned", _unaligned(clean)),
        ("objects", clean.astype(object)),
        ("read-only", _read_only(clean)),
        ("subclass", clean.view(np.ma.MaskedArray)),
    ):
        yield Variant(name, value, clean)
    rough = clean if whole else clean.astype(np.float32).astype(np.float64)
    yield Variant("float32", rough.astype(np.float32), rough)
    ints = np.rint(clean).astype(clean.dtype)
    yield Variant("integers", ints.astype(np.int32), ints)
    yield Variant("strings", clean.astype(str), None)
    yield Variant("bytes", clean.astype("S8"), None)
    yield Variant("complex", clean + 0.5j, None)
    yield Variant("None", None, None)
    yield Variant("text", "alten", None)
    yield Variant("one number short", clean[..., :-1], None)
    yield Variant("one number long", np.concatenate([clean, clean[..., :1]], axis=-1), None)
    yield Variant("no numbers", clean[..., :0], None)
    yield Variant("empty", [], None)
    yield Variant("ragged", [[0.0, 1.0], [0.0]], None)
    if not rows:
        yield Variant("one number", 0.125, None)
        yield Variant("a dimension more", clean[None], None)
        if clean.ndim > 1:
            yield Variant("a row short", clean[:-1], None)
            yield Variant("no rows", clean[:0], None)
    if not whole:
        for bad in (np.nan, np.inf, -np.inf, 1e300):
            for place in (0, -1):
                value = clean.copy()
                value.reshape(-1)[place] = bad
                yield Variant(f"{bad} at {place}", value, None)


def _unaligned(clean: np.ndarray) -> np.ndarray:
    room = np.zeros(clean.nbytes + 1, np.uint8)
    array = room[1:].view(clean.dtype).reshape(clean.shape)
    array[...] = clean
    return array


def _read_only(clean: np.ndarray) -> np.ndarray:
    array = clean.copy()
    array.flags.writeable = False
    return array


def numbers(result: object) -> list[np.ndarray]:
    """Return every array and number in a result."""
    if isinstance(result, Log):
        return [np.asarray(result[name]) for name in result]
    if is_dataclass(result):
        return [one for field in fields(result) for one in numbers(getattr(result, field.name))]
    if result is None or isinstance(result, str):
        return []
    return [np.asarray(result, dtype=float)]


def wrong(case: Case, name: str, variant: Variant) -> str | None:
    """Return what is wrong with the answer to a variant of one of a case's arrays, or None."""
    own = case.arrays | {name: variant.value}
    try:
        found = numbers(case.call(own))
    except (InputError, ValueError, TypeError) as error:
        text = str(error)
        return None if text.strip() and "\n" not in text else f"raises {error!r}, which is no sentence"
    except Exception as error:
        return f"raises {error!r}"
    if variant.same is None:
        welcome = {
            "1e+300": True,
            "nan": case.missing,
            "inf": case.missing or name in case.unbounded,
            "-inf": case.missing or name in case.unbounded,
            "None": name in case.optional,
            "one": name in case.lengths,
        }
        return None if welcome.get(variant.name.split()[0], False) else "is answered"
    expected = numbers(case.call(case.arrays | {name: variant.same}))
    same = len(found) == len(expected) and all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(found, expected, strict=True)
    )
    return None if same else "is answered otherwise than the clean array"


def walk() -> tuple[int, list[str]]:
    """Return how many calls were made, and what went wrong in which."""
    calls, failures = 0, []
    for function, case in cases():
        case.call(case.arrays)  # the clean call must do
        for name, clean in case.arrays.items():
            for variant in variants(np.asarray(clean), rows=name in case.rows):
                calls += 1
                found = wrong(case, name, variant)
                if found is not None:
                    failures.append(f"{function}: {name} as {variant.name} {found}")
    return calls, failures


def entries() -> dict[str, Dispatcher]:
    """Return every compiled function of the package that Python can call, by its full name."""
    found = {}
    for module in pkgutil.walk_packages(ballbot.__path__, "ballbot."):
        if module.name.endswith("__main__"):
            continue
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, Dispatcher) and not value.targetoptions.get("no_cpython_wrapper"):
                home = value.py_func.__module__
                if home.startswith("ballbot."):
                    found[f"{home}.{value.py_func.__name__}"] = value
    return found


def other_arrays(dispatcher: Dispatcher) -> list[str]:
    """Return the array types for which a function was compiled, other than those that `real_array` gives."""
    usual = (types.float64, types.int64, types.boolean)
    return [
        str(one)
        for signature in dispatcher.signatures
        for one in signature
        if isinstance(one, types.Array) and not (one.mutable and one.aligned and one.dtype in usual)
    ]


#: compiled functions that get no array from outside, and whose arrays they get
OWN_ARRAYS = {
    "ballbot.simulation.model_plant.friction_needed_along": "those of the closed loop that `reference_margins` has run",
}


def overrun() -> str:
    """Return what compiled code raises for an array that is too short; without the bounds check it returns torques."""
    from ballbot.control.law import MEMORY_SIZE, control_law

    try:
        control_law(CONTROLLER.packed, np.zeros(MEMORY_SIZE), np.zeros(10), np.zeros(9), np.zeros(3))
    except IndexError as error:
        return str(error)
    return "not caught"


def main() -> None:
    """Walk, and print what was found as JSON."""
    calls, failures = walk()
    compiled = entries()
    report = {
        "calls": calls,
        "cases": [name for name, _ in cases()],
        "failures": failures,
        "entries": sorted(compiled),
        "not reached": sorted(
            name for name, one in compiled.items() if not one.signatures and name not in OWN_ARRAYS
        ),
        "other arrays": {name: found for name, one in compiled.items() if (found := other_arrays(one))},
        "overrun": overrun(),
    }
    json.dump(report, sys.stdout)


if __name__ == "__main__":
    main()
