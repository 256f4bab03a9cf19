"""`ballbot identify`: a robot's friction, and other parameters on request, from balancing logs."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.arguments import names_listed
from ballbot.cli import options
from ballbot.cli.context import changed_robot, open_result, read_balancing_log
from ballbot.cli.findings import check_input
from ballbot.errors import InputError
from ballbot.fitting.run import Run
from ballbot.identification import Bounds, cross_validate, read_bounds
from ballbot.identification.identify import IdentificationOptions
from ballbot.identification.identify import identify as identify_friction
from ballbot.identification.windows import back_emf_of
from ballbot.log.checks import CheckedLogs
from ballbot.log.collection import named_files
from ballbot.report.identification import identification_report


def identify(
    robot: options.Robot,
    /,
    *logs: options.Log,
    change: options.Changes = None,
    out: options.Out,
    estimate: str = "friction",
    law: str = "stribeck",
    exclude_states: str = "",
    bounds: Path | None = None,
    window: options.Window = 0.25,
    seed: options.Seed = 0,
    holdout: Annotated[list[Path] | None, Parameter(negative="")] = None,
    mapping: Annotated[list[Path] | None, Parameter(negative="")] = None,
    accept: options.Accept = None,
) -> None:
    """Identify a robot's friction from its logs: b, c, s of each wheel, v_s, delta and C_rr. --estimate adds other
    parameters.

    Writes report.html, robot.toml (the robot with the identified values) and results.json.
    The verdict says whether the result is usable. If not, there is no robot.toml and the exit code is 2.

    Example: ballbot identify alten square.csv hold.csv --out found

    Example: ballbot identify alten square.csv --estimate friction,delay,torque_gain --law best --out found

    Parameters
    ----------
    logs
        One or more logs of the robot balancing, with torques and states.
    estimate
        What to estimate, separated by commas: friction, rigid_body (center_of_mass, second_moment), ball_inertia,
        wheel_inertia, rotor_inertia, torque (torque_gain, torque_offset, delay), delays (delay, imu_delay,
        velocity_delay), bias (lean_bias, gyro_bias), pivoting (resistance of the floor to turning on the spot), or
        single quantities of friction, such as viscous.
    law
        The friction law of the wheels: viscous, coulomb, stribeck, asymmetric, directed or load. best fits each in
        turn, shows how much each improves the prediction of held-out windows, and keeps the law that improves it
        clearly. FILE.py:NAME is a law of your own, which that file registers.
    exclude_states
        States whose errors do not count in the fit, separated by commas, such as psi,psi_dot if the ball pivots on the
        floor.
    bounds
        A TOML file with lower and upper bounds, such as: coulomb = [0.0, 0.5]. Equal bounds fix a value.
    holdout
        A log that is not fitted, on which the result is validated. May be given more than once.
    mapping
        A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it: one for all
        logs, or one for each, in the order of the logs and then of those of --holdout.
    """
    described = changed_robot(robot, change)
    named, held_out = named_files(logs), named_files(holdout) if holdout else {}
    paths = [*named.values(), *held_out.values()]
    if len(mapping or ()) not in (0, 1, len(paths)):
        raise InputError("Give one --mapping for all logs, or one for each, in the order of the logs.")
    mappings = mapping if mapping and len(mapping) == len(paths) else (mapping or [None])[:1] * len(paths)
    read = [read_balancing_log(*each, described) for each in zip(paths, mappings, strict=True)]
    within = read_bounds(bounds) if bounds else Bounds()
    # all logs are checked together, because they are of one robot
    findings = check_input(described, paths, read, accept=accept)
    checked = CheckedLogs(logs=dict(zip(named, read, strict=False)), findings=findings)
    with open_result(out, doing="identifying", writes=["robot.toml"], seed=seed) as result:
        fit = identify_friction(
            described,
            checked,
            free=estimate,
            law=law,
            bounds=within,
            window=window,
            options=IdentificationOptions(
                excluded_states=names_listed(exclude_states),
                back_emf=back_emf_of(mapping or (), described),
                accept=accept or (),
            ),
            run=Run(seed=seed, progress=result.report),
        )
        rest = slice(len(named), None)
        holdouts = [
            cross_validate(fit, log, name=name) for name, log in zip(held_out, read[rest], strict=True)
        ]
        page = identification_report(fit, checked.logs, holdouts)
        step = f"`ballbot validate {result.path('robot.toml')} LOG --out checked`, with a log that was not fitted"
        result.write_robot(page, fit.robot, fit.verdict, next_step=step)
