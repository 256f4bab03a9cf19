"""The driveline stage on the shared sweep: five parameters a wheel, with the speed clamp read in two ways."""

from __future__ import annotations

from ballbot.findings import texts
from ballbot.identification.driveline import NAMES, fit_as_printed, fit_driveline, sweeps_of
from ballbot.log import Log
from ballbot.report.driveline import UNITS, driveline_findings
from ballbot.report.tables import with_error
from ballbot.robot import Robot
from campaigns.section import Section, data_folder


def campaign() -> Section:
    """Fit every wheel and return the section of docs/generated/evidence.md."""
    log = Log.read(data_folder() / "bbr" / "driveline_sweep.csv")
    sweeps = sweeps_of(Robot.load("alten"), log)
    fits = [fit_driveline(sweep) for sweep in sweeps]
    printed = [fit_as_printed(sweep, fit) for sweep, fit in zip(sweeps, fits, strict=True)]
    rows = [
        [
            f"{name} [{unit}]" if unit else name,
            *(with_error(float(fit.values[i]), float(fit.standard_errors[i])) for fit in fits),
        ]
        for i, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
    ]
    rows.append(["RMS speed error [rad/s]", *(f"{fit.rmse:.3f}" for fit in fits)])
    rows.append(["clamp (3.2) as printed, its own best", *(f"{one.rmse:.2f}" for one in printed)])
    rows.append(
        ["clamp (3.2) as printed, the friction above", *(f"{one.rmse_restarted:.1f}" for one in printed)]
    )
    rows.append(["without friction", *(f"{fit.rmse_without:.1f}" for fit in fits)])
    return Section(
        title="Stage one: the drivelines, wheels free",
        before="A sweep of the test robot (see [errors with identified friction](#errors-with-identified-friction-"
        "over-those-without)), 1 N m and 62.83 s. The thesis's five parameters and cost (3.5), by an evolution "
        "strategy and a polish; standard errors clustered in time.",
        columns=["", *(f"wheel {fit.wheel}" for fit in fits)],
        rows=rows,
        after=" ".join(texts(driveline_findings(fits, printed))),
    )
