"""One wheel held by dry friction below its breakaway torque: MuJoCo's frictionloss creeps, Ballbot's does not.

    .venv/bin/python -m campaigns.evidence one_wheel

(j_w + j_r) w_dot = u - friction, |friction| <= c + s at rest. MuJoCo treats friction as a constraint with compliance:
the wheel turns at the speed at which the constraint's damping gives the force,

    w = u (1 - d) / d / ((j_w + j_r) b),    b = 2 / (d_max timeconst),

with d the impedance at zero and d_max its width (`solimp`), and timeconst of `solref`: proportional to the torque.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from ballbot import Robot
from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.simulation.driveline import Driveline, simulate_driveline
from campaigns.section import Section

#: c + s of the nominal scenario's first wheel, at rest [N m]
BREAK_AWAY = 0.16
STEP = 1e-3
SHARES = (0.1, 0.5, 0.9, 0.99)


@dataclass(frozen=True, kw_only=True)
class Engine:
    """How MuJoCo is set."""

    name: str
    impedance: float = 0.9  #: solimp's d_0 = d_width
    time_constant: float = 0.02  #: solref's [s]
    no_slip: int = 0  #: iterations of the no-slip solver after the constraints'


#: as MuJoCo comes; as stiff as its solver takes at this step; and with the solver that it has for slip
ENGINES = (
    Engine(name="MuJoCo, defaults"),
    Engine(name="MuJoCo, solimp 0.9999, solref 2 ms", impedance=0.9999, time_constant=2e-3),
    Engine(name="MuJoCo, defaults, 10 no-slip iterations", no_slip=10),
)


def inertia() -> float:
    """Return j_w + j_r of the thesis's robot [kg m^2]."""
    return Driveline.of_wheel(Robot.load("alten"), 0).inertia


def mujoco_creep(engine: Engine, torque: float, *, duration: float = 2.0) -> float:
    """Return the wheel's mean speed [rad/s] over the second half of a run from rest."""
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP
    spec.option.noslip_iterations = engine.no_slip
    wheel = spec.worldbody.add_body()
    wheel.mass, wheel.inertia = 1.0, [1e-9] * 3  # all inertia is the armature's
    wheel.explicitinertial = True
    wheel.add_joint(
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, 1.0],
        armature=inertia() - 1e-9,
        frictionloss=BREAK_AWAY,
        solref_friction=[engine.time_constant, 1.0],
        solimp_friction=[engine.impedance, max(engine.impedance, 0.95), 0.001, 0.5, 2.0],
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = torque
    half = round(duration / STEP / 2)
    mujoco.mj_step(model, data, nstep=half)
    before = float(data.qpos[0])
    mujoco.mj_step(model, data, nstep=half)
    return (float(data.qpos[0]) - before) / (half * STEP)


def our_creep(torque: float, *, duration: float = 2.0) -> float:
    """Return the same of our driveline with the classical law."""
    law = Classical(viscous=0.014, coulomb=0.11, stribeck=0.05, stribeck_speed=0.6, stribeck_exponent=1.1)
    wheel = Driveline(inertia=inertia(), friction=law)
    run = simulate_driveline(wheel, np.full(round(duration / STEP), torque), sample_time=STEP)
    half = len(run.angles) // 2
    return float(run.angles[-1] - run.angles[half - 1]) / (half * STEP)


def campaign() -> Section:
    """Return the creep at the wheel's rim [um/s]."""
    torques = [share * BREAK_AWAY for share in SHARES]
    rows = [[engine.name, *(_at_rim(mujoco_creep(engine, u)) for u in torques)] for engine in ENGINES]
    rows.append(["ballbot", *(_at_rim(our_creep(u)) for u in torques)])
    return Section(
        title="One wheel below its breakaway torque",
        before="Creep at the wheel's rim in micrometres a second, 1 s to 2 s after the torque begins, steps of 1 ms; "
        f"break-away at c + s = {BREAK_AWAY} N m, inertia {inertia():.3g} kg m^2. MuJoCo {mujoco.__version__}, "
        "frictionloss on a hinge.",
        columns=["share of the break-away torque", *(f"{share:g}" for share in SHARES)],
        rows=rows,
        after="MuJoCo's friction is a constraint with compliance, so that a wheel at rest creeps in proportion to its "
        "torque; stiffer settings reduce the creep. Its no-slip solver, off by default, removes all but rounding "
        "errors. In Ballbot the creep is exactly zero.",
    )


def _at_rim(speed: float) -> str:
    """Return a wheel's speed [rad/s] as its rim's, in micrometres a second."""
    creep = 1e6 * Robot.load("alten").wheels.radius * speed
    return f"{creep:.0f}" if abs(creep) >= 10.0 or creep == 0.0 else f"{creep:.2g}"
