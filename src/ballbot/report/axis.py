"""An axis's identification: figures of its friction, its open-loop position and its laws, and its page."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure

from ballbot.findings import Finding, by_severity, texts
from ballbot.identification.axis import AxisIdentification, AxisRecord
from ballbot.identification.axis.identify import open_loop_error
from ballbot.identification.axis.model import LAWS, PARAMETERS, unit_for
from ballbot.identification.axis.motion import motion_of
from ballbot.report.blocks import Bullets, Paragraph, Result, Section, Sheet, section
from ballbot.report.palette import BLUE, INK, MUTED
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.style import LOOKS, drawn_picture, one_panel
from ballbot.report.words import capital
from ballbot.rounding import DASH, digits, plus_minus, unit_heading

#: findings that stand in the verdict; the others stand with the parameters
_IN_VERDICT = 2
#: how a row of the verdict is headed, by the finding's code
_VERDICT_WORDS = {"another-force": "Another force", "force-delay": "Delay", "law": "Law"}
#: forces that are selected in addition to the law
_FORCES = {"gravity": "gravity", "load": "dry friction that grows with the load"}


def axis_friction_figure(fit: AxisIdentification, record: AxisRecord) -> Figure:
    """Return the friction over speed: the force less all other forces, and the laws found."""
    motion = motion_of(record)
    others = fit.best.axis().other_forces(record.force, motion.position, motion.speed, motion.acceleration)
    friction, fastest = record.force - others, float(np.abs(motion.speed).max())
    moving = np.flatnonzero(np.abs(motion.speed) > 0.02 * fastest)
    moving = moving[:: max(1, len(moving) // 3000)]
    across, up = unit_heading("speed", f"{fit.unit}/s"), unit_heading("friction", record.force_unit)
    figure, axes = one_panel(across, up)
    dots = {"color": MUTED, "markersize": 1.6, "alpha": 0.5}
    axes.plot(motion.speed[moving], friction[moving], ".", label="record", **dots)
    side = np.linspace(1e-4, 1.0, 200) * fastest
    speed = np.concatenate([-side[::-1], [np.nan], side])
    style = {**LOOKS["first"], "linewidth": 1.4}
    axes.plot(speed, fit.best.axis().friction(speed), label=fit.law, **style)
    middle = float(np.quantile(np.abs(friction[moving]), 0.99))
    axes.set_ylim(-1.3 * middle, 1.3 * middle)
    axes.legend(loc="upper left", markerscale=5.0)
    return figure


def open_loop_series(fit: AxisIdentification, record: AxisRecord, of_record: str) -> TimeSeries:
    """Return the position, and the errors of its simulation from the recorded force alone."""
    error = Line(
        f"{fit.law}: {1e3 * fit.best.errors[record.name].open_loop_rmse:.3g} m{fit.unit} RMS",
        1e3 * np.append(0.0, open_loop_error(fit.best.axis(), record)),
        "first",
    )
    position = Panel(
        unit_heading("recorded position", fit.unit), [Line("recorded", record.position, "measured")]
    )
    return TimeSeries(
        record.t,
        (position, Panel(unit_heading("error of the position", f"m{fit.unit}"), [error])),
        f"Open loop over the whole record{of_record}: the recorded force moves the axis from its first state.",
    )


def laws_figure(fit: AxisIdentification) -> Figure:
    """Return each law's gain on held-out blocks over the simpler law, with its 95 % interval."""
    compared = [(name, estimate.gain) for name, estimate in fit.by_law.items() if estimate.gain]
    figure, axes = one_panel("less error on held-out blocks [%]", "", height=0.6 + 0.42 * len(compared))
    ends = np.array([(100.0 * gain.lower, 100.0 * gain.upper) for _, gain in compared])
    left = max(-100.0, min(-5.0, 1.1 * float(ends.min())))
    for row, (_, gain) in enumerate(reversed(compared)):
        color = BLUE if gain.significant else MUTED
        low, middle, high = (100.0 * share for share in (gain.lower, gain.share, gain.upper))
        axes.plot([low, high], [row, row], color=color, linewidth=2.0)
        axes.plot(middle, row, "o", color=color, mfc=color if gain.significant else "white", markersize=5)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(compared)), [f"{name} over {LAWS[name][1]}" for name, _ in reversed(compared)])
    axes.set_xlim(left, max(5.0, 1.1 * float(ends.max())))
    return figure


def axis_report(
    fit: AxisIdentification, record: AxisRecord | None = None, findings: Sequence[Finding] = ()
) -> Result:
    """Return the page, with the first record over time if it is given."""
    count, shown = len(fit.records), fit.findings[:_IN_VERDICT]
    of_record = f"{record.duration:.1f} s at {1.0 / record.sample_time:.0f} Hz" if record else "One"
    records = "" if count == 1 else f"{count} records fitted together, the first of "
    words = {
        symbol: f"{meaning} {symbol} = {value} {unit}".rstrip()
        for symbol, meaning, unit, value in parameter_rows(fit)
    }
    one_record = "How much parameters differ from record to record: there is one (--also adds records)."
    mass, judge = capital(words.pop("M")), fit.best.model.judge
    return Result(
        title=f"{', '.join(fit.records)}: mass and friction",
        lead=f"{records}{of_record}; the law {fit.law}, fitted over windows of {fit.window:.3g} s.",
        verdict=[
            ("Mass and friction", f"{mass}; by the law {fit.law}: {', '.join(words.values())}."),
            ("Prediction", expected_sentence(fit)),
            *((_VERDICT_WORDS.get(finding.code, ""), finding.text) for finding in shown),
        ],
        sections=list(_sections(fit, record)),
        undecided=[
            one_record if count == 1 else "",
            "The friction at speeds, loads and temperatures that the records do not have.",
        ],
        findings=findings,
        data={
            "records": fit.records,
            "unit": fit.unit,
            "law": fit.law,
            "terms": {name: gain.with_interval() for name, gain in fit.forces.items()},
            "force_between_rows": "interpolated" if fit.best.model.interpolated else "held",
            "window": fit.window,
            "parameters": fit.best.values,
            "standard_errors": fit.best.standard_errors,
            "laws": fit.by_law,
            "judged_by": judge,
            "expected_elsewhere": {f"{judge}_rmse": fit.expected[0], "interval_95": fit.expected[1:]},
            "findings": by_severity([*findings, *fit.findings]),
        },
    )


def _sections(fit: AxisIdentification, record: AxisRecord | None) -> Iterator[Section]:
    of_record = f" ({fit.records[0]})" if len(fit.records) > 1 else ""
    method = (
        "The axis is simulated over windows, each from its best start; with these parameters the positions come "
        "closest to the recorded ones. The standard errors treat residuals that are close in time as dependent, and "
        "include how far parts of the records and the inverse model differ beyond chance."
    )
    others = "other forces and the friction under load" if "load" in fit.best.values else "other forces"
    friction = f"Friction over speed{of_record}: force less inertia, offset, {others}, and the laws found."
    forces = [
        (_FORCES[name], *(f"{digits(100.0 * share)} %" for share in (gain.share, gain.lower, gain.upper)))
        for name, gain in fit.forces.items()
    ]
    selected = Sheet(
        ("force", "less error", "at least", "at most"),
        forces,
        "Selected by the error on held-out blocks; with 95 % intervals.",
    )
    yield section(
        "Parameters",
        Bullets(texts(fit.findings)[_IN_VERDICT:]),
        Sheet(("symbol", "meaning", "unit", "value"), parameter_rows(fit), brief=(0, 3, 2)),
        Paragraph(method),
        selected if forces else None,
        drawn_picture("friction", friction, axis_friction_figure, fit, record) if record else None,
    )
    scale, unit = fit.best.model.error_unit(fit.unit)
    errors = [
        (name, of, *(f"{digits(e)} {own}" if np.isfinite(e) else DASH for e, own in numbers))
        for name, estimate in fit.by_law.items()
        for of, error in estimate.errors.items()
        for numbers in [((scale * error.window_rmse, unit), (1e3 * error.open_loop_rmse, f"m{fit.unit}"))]
    ]
    laws = (
        "Each law compared with the simpler law, on blocks that neither was fitted to; bars are 95 % intervals, with a "
        "filled dot if it predicts better."
    )
    yield section(
        "Predictions and laws",
        Sheet(
            ("law", "record", f"{fit.best.model.judge}, windows", "position, whole"),
            errors,
            "Every law on each record, RMS. Windows: as fitted, positions each from its best start; whole: the record "
            "from its first row.",
        ),
        open_loop_series(fit, record, of_record) if record and len(record.parts) == 1 else None,
        drawn_picture("laws", laws, laws_figure, fit),
    )


def parameter_rows(fit: AxisIdentification) -> list[tuple[str, str, str, str]]:
    """Return the parameters of the result: symbol, meaning, unit and value with its standard error."""
    return [
        (kind.symbol, kind.meaning, unit_for(kind, fit.unit), plus_minus(value, error))
        for name, value in fit.best.values.items()
        for kind, error in [(PARAMETERS[name], fit.best.standard_errors[name])]
    ]


def expected_sentence(fit: AxisIdentification) -> str:
    """Return the error to expect on another record."""
    scale, unit = fit.best.model.error_unit(fit.unit)
    error, low, high = (digits(scale * value) for value in fit.expected)
    return (
        f"On another record under these conditions the {fit.best.model.judge} error over windows of {fit.window:.3g} s "
        f"should be {error} {unit} RMS, with a 95 % interval of {low} to {high} {unit}, from held-out blocks."
    )
