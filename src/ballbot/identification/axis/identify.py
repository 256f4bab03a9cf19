"""Identification of one axis: a wheel, a motor, a joint or a slide.

The experiment (`axis_experiment`) minimises the output error: simulated less recorded positions over windows of the
records, under the recorded force. Position and speed at the start of a window are its states, which the fit eliminates,
so that noise there does not count as friction. Windows last `WINDOW`: over much shorter ones the noise of the start
hides the friction; over much longer ones a single moment of sticking determines all that follows.

Another force, as from coupled joints, moves positions by more than friction does. If the balance of forces leaves one
and positions do not contradict it, residuals are the low-passed force that the model leaves, in blocks as long.

Start values are from the inverse model (`motion`). Of nested models (gravity, friction under load, a friction law) each
is kept if it predicts held-out blocks of time better than the simpler one and its own parameters are determined. Of a
law `stribeck` that is requested, so is delta, which is otherwise 1 with a standard deviation that the errors include.
Intervals are from the covariance clustered in time, and from differences beyond chance to the inverse model and to each
record by itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.errors import InputError, check_known
from ballbot.findings import Finding, finding, note, warning
from ballbot.fitting.experiment import BlockErrors, Residuals, residuals_without_states
from ballbot.fitting.fit import Fit, fit, held_out_squares, released
from ballbot.fitting.model_selection import Gain, blocks_of, gain_between
from ballbot.fitting.parameter import FitParameter, ParameterSpace
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import resamples
from ballbot.identification.axis.model import FORCES, LAWS, PARAMETERS, Axis, AxisModel, Values, unit_for
from ballbot.identification.axis.motion import (
    CLEAR,
    AxisMotion,
    inverse_model,
    motion_of,
    speed_at_start,
    with_gravity,
)
from ballbot.identification.axis.record import AxisRecord
from ballbot.progress import Progress
from ballbot.summary import Reported

#: length of a window [s]; shorter if the records would have fewer than `_LEAST_WINDOWS`
WINDOW = 1.0
#: least windows for a covariance of six parameters
_LEAST_WINDOWS = 9
#: standard deviation of a delta that is held at 1: laws in use have 0.5 to 2 (B. Armstrong-Helouvry, P. Dupont and
#: C. Canudas de Wit, A survey of models, Automatica 30 (1994) 1083-1138), and 2 is then two deviations away
DELTA_DEVIATION = 0.5
DELTA_HELD = note(
    "excitation",
    "How sharply s fades with speed does not show: delta is held at 1. If it is larger, s is smaller and v_s larger. "
    "The 95 % intervals include what deltas from 0.5 to 2 would change.",
)
#: positions are compared at this interval [s]
_COMPARED_EVERY = 0.01
#: prior standard deviation of a start's speed, as a share of the usual speed
_START_SPEED = 0.2
#: finite differences of a start's position and speed, in standard deviations
_START_STEPS = np.array([10.0, 0.05])


def window_duration(motions: Sequence[AxisMotion]) -> float:
    """Return the length of the windows [s]."""
    return min(WINDOW, sum(motion.record.duration for motion in motions) / _LEAST_WINDOWS)


def axis_experiment(model: AxisModel, motions: Sequence[AxisMotion], duration: float) -> Residuals:
    """Return the experiment of a model on windows of about this duration [s], end to end between gaps."""
    if model.judge == "force":
        return _force_experiment(model, motions, duration)
    windows = []
    for number, motion in enumerate(motions):
        for begin, end in motion.record.long_parts:
            pieces = max(1, round((end - 1 - begin) / (duration / motion.record.sample_time)))
            edges = np.unique(np.linspace(begin, end - 1, pieces + 1).astype(int)).tolist()
            windows += [(number, a, b - a) for a, b in pairwise(edges)]
    log, first, count = np.array(windows, dtype=np.int64).T.copy()
    starts, sizes, compared, measured = [], [], [], []
    for number, a, rows in windows:
        motion, record = motions[number], motions[number].record
        filtered = float(motion.position[a]), float(motion.speed[a])
        starts.append(filtered if a else (float(record.position[0]), speed_at_start(record)))
        # standard deviations of a start's position (at least rounding) and speed
        noise = max(motion.noise, 1e-9 * float(np.ptp(record.position)))
        sizes.append((noise, _START_SPEED * motion.usual_speed))
        every = max(1, round(_COMPARED_EVERY / record.sample_time))
        compared.append(np.arange(min(every, rows), rows + 1, every))
        measured.append(record.position[a + compared[-1]])
    start, size = np.array(starts), np.array(sizes)

    def errors(values: Floats, states: Floats, blocks: Ints) -> Floats:
        """Return simulated less recorded positions, from starts that differ by so many standard deviations."""
        named = dict(zip(model.names, values.tolist(), strict=True))
        axis, begin, positions = model.axis(named), start[blocks] + states * size[blocks], []
        for number, motion in enumerate(motions):
            own, record, force = log[blocks] == number, motion.record, motion.record.force
            if delay := named.get("delay"):
                force = np.interp(record.t - delay, record.t, force)
            rows = first[blocks[own]], count[blocks[own]], begin[own]
            positions.append(axis.windows(force, record.sample_time, *rows)[:, 0])
        before = np.cumsum(count[blocks]) - count[blocks] - 1
        rows = np.concatenate([compared[block] + row for block, row in zip(blocks, before, strict=True)])
        return np.concatenate(positions)[rows] - np.concatenate([measured[block] for block in blocks])

    return Residuals(
        coordinates=ParameterSpace(parameters=_parameters(model, motions)).holding(*model.held),
        errors_of=errors,
        block=np.repeat(np.arange(len(log)), [len(rows) for rows in measured]),
        block_log=log,
        state_steps=_START_STEPS,
        state_weight=size[:, 0],
    )


def _force_experiment(model: AxisModel, motions: Sequence[AxisMotion], duration: float) -> Residuals:
    """Return the experiment of a model on the force that it leaves in motion, in blocks of a duration [s]."""
    rows = [np.flatnonzero(motion.moving) for motion in motions]
    times = [motion.record.t[own] // duration for motion, own in zip(motions, rows, strict=True)]
    log = np.repeat(np.arange(len(motions)), [len(own) for own in rows])
    blocks, block = np.unique(np.column_stack([log, np.concatenate(times)]), axis=0, return_inverse=True)

    def errors(values: Floats) -> Floats:
        named = dict(zip(model.names, values.tolist(), strict=True))
        left = (_force_left(model.axis(named), motion, named.get("delay", 0.0)) for motion in motions)
        return np.concatenate([force[own] for force, own in zip(left, rows, strict=True)])

    of, block_log = _parameters(model, motions), blocks[:, 0].astype(int)
    plain = residuals_without_states(errors, parameters=of, block=block.ravel(), block_log=block_log)
    return replace(plain, coordinates=plain.coordinates.holding(*model.held))


def _force_left(axis: Axis, motion: AxisMotion, delay: float = 0.0) -> Floats:
    """Return the low-passed force (N,) that neither motion nor friction of an axis explains, acting late [s]."""
    force, t = motion.force(interpolated=axis.interpolated), motion.record.t
    force = np.interp(t - delay, t, force) if delay else force
    others = axis.other_forces(force, motion.position, motion.speed, motion.acceleration)
    return motion.lowpassed(force - others - axis.friction(motion.speed))


def _parameters(model: AxisModel, motions: Sequence[AxisMotion]) -> tuple[FitParameter, ...]:
    """Return the parameters, with bounds from the largest force, speed and acceleration in the records."""
    force, speed, acceleration = (
        max(float(np.abs(values).max()) for values in column)
        for column in zip(*((m.record.force, m.speed, m.acceleration) for m in motions), strict=True)
    )
    sizes = {"kg": force / acceleration, "N s/m": force / speed, "N": force, "m/s": speed}
    scaled = [(PARAMETERS[name], sizes.get(PARAMETERS[name].unit, 1.0)) for name in model.names]
    return tuple(
        replace(parameter, bounds=(size * parameter.bounds[0], size * parameter.bounds[1]))
        for parameter, size in scaled
    )


@dataclass(frozen=True, kw_only=True)
class AxisErrors:
    """Prediction errors on a record."""

    #: as fitted: of the position over windows, from their best starts [m], or of the force [N]
    window_rmse: float
    open_loop_rmse: float  #: of the position over the complete record, from its start [m]; NaN with gaps


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisEstimate:
    """A model fitted to windows."""

    model: AxisModel
    motions: tuple[AxisMotion, ...]  #: of the records
    fit: Fit[BlockErrors]
    standard_errors: dict[str, float]  #: by name, clustered by window; NaN for a parameter at a bound
    errors: dict[str, AxisErrors] = field(default_factory=dict)  #: by record: first those fitted, then others
    gain: Gain | None = None  #: on held-out blocks over the simpler law

    @cached_property
    def values(self) -> dict[str, float]:
        """The parameters by name, SI units."""
        return dict(zip(self.model.names, self.fit.values.tolist(), strict=True))

    @property
    def rms(self) -> float:
        """Root mean square error of the positions [m], or of the force [N]."""
        return float(np.sqrt(np.mean(self.fit.finished.end.errors**2)))

    @cached_property
    def held_out(self) -> Floats:
        """Mean square error [m^2 or N^2] of each window (w,), by a fit that did not see its block."""
        return held_out_squares(self.fit)

    def gain_over(self, simpler: AxisEstimate) -> Gain:
        """Return the gain on held-out blocks over a simpler model."""
        return gain_between(self.held_out[:, None], simpler.held_out[:, None], blocks_of(len(self.held_out)))

    def is_clear(self, name: str) -> bool:
        """Return whether a parameter differs from zero beyond chance."""
        return abs(self.values[name]) > CLEAR * self.standard_errors[name]

    @property
    def half_widths(self) -> dict[str, float]:
        """Half widths of the 95 % intervals, by name."""
        return {name: self.fit.quantile * error for name, error in self.standard_errors.items()}

    def axis(self) -> Axis:
        """Return the axis with the estimated parameters."""
        return self.model.axis(self.values)

    def on(self, motion: AxisMotion, duration: float) -> AxisErrors:
        """Return the prediction errors on a record, over windows of a duration [s] and over all of it."""
        windows, open_loop = axis_experiment(self.model, [motion], duration), np.full(1, np.nan)
        end = windows.begin(windows.coordinates.scaled(self.fit.values))
        if len(motion.record.parts) == 1:
            open_loop = open_loop_error(self.axis(), motion.record)
        over_windows, over_all = (float(np.sqrt(np.mean(errors**2))) for errors in (end.errors, open_loop))
        return AxisErrors(window_rmse=over_windows, open_loop_rmse=over_all)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        halves = self.half_widths
        return {
            "parameters": self.values,
            "standard_errors": self.standard_errors,
            "intervals_95": {name: [v - halves[name], v + halves[name]] for name, v in self.values.items()},
            "errors": self.errors,
            "simpler": LAWS[self.model.law][1],
            "gain": self.gain and self.gain.with_interval(),
        }


def open_loop_error(axis: Axis, record: AxisRecord) -> Floats:
    """Return the error [m] of the position (N - 1,) after each row, simulated from the first row on."""
    start = np.array([[record.position[0], speed_at_start(record)]])
    rows = np.array([0]), np.array([len(record) - 1])
    return axis.windows(record.force, record.sample_time, *rows, start)[:, 0] - record.position[1:]


def fit_axis(model: AxisModel, motions: Sequence[AxisMotion], start: Values) -> AxisEstimate:
    """Fit a model, starting from parameters by name; InputError if the simulation diverges there."""
    experiment = axis_experiment(model, motions, window_duration(motions))
    point = experiment.coordinates.scaled(np.array([start[name] for name in model.names]))
    if not np.isfinite(experiment.costs(point[None])).all():
        raise InputError(
            "The simulation of the axis diverges over windows of the record; check the unit of the force."
        )
    result = fit(experiment, point)
    errors = dict(zip(model.names, result.errors.tolist(), strict=True))
    return AxisEstimate(model=model, motions=tuple(motions), fit=result, standard_errors=errors)


#: least gain on held-out blocks for which a force or a law is kept
USEFUL_GAIN = 0.02
#: start values: Stribeck speeds over the fastest speed, and the friction share of the load
_STRIBECK_STARTS, _LOAD_START = (0.03, 0.15), 0.05
#: largest Stribeck speed over the fastest speed; above it, the law fits another curve than a fading break-away force
_FADES = 0.5
#: share of the squared force that a regression explains and a fit leaves if the two contradict each other; 0.002 at
#: most of the machines of campaigns/one_axis.py
_CONTRADICTED = 0.05
#: share of the squared force that a regression leaves if another force acts, 0.0014 on the benchmark EMPS, 0.008 to 0.1
#: on joints of an arm that move together; and share that it explains at least if it is a model of the axis
_ANOTHER_FORCE, _LEAST_EXPLAINED = 0.005, 0.75
_DRAWS, _SEED = 2000, 0


@dataclass(frozen=True, kw_only=True)
class AxisOptions:
    """Options of `identify_axis`; those that are None are selected by errors on held-out blocks.

    InputError if there is no such law.

    >>> AxisOptions(law="stribeck", gravity=False).load_friction is None
    True
    """

    law: str | None = None
    """The friction law: viscous, coulomb or stribeck."""

    gravity: bool | None = None
    """Whether gravity acts on an axis that turns: S sin q + C cos q."""

    load_friction: bool | None = None
    """Whether dry friction grows with the load that the gears transmit, |F + G| / 2."""

    def __post_init__(self) -> None:
        if self.law is not None:
            sentence = f"There is no friction law {self.law!r} (--law)"
            check_known(self.law, LAWS, sentence, otherwise="the laws are")


DEFAULT_OPTIONS = AxisOptions()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AxisIdentification(Reported):
    """Result of `identify_axis`; `plot()` shows each law's gain on held-out blocks over the simpler one."""

    records: tuple[str, ...]  #: names of the fitted records
    unit: str  #: of positions: "m" or "rad"
    forces: dict[str, Gain]  #: gains of gravity and load, if they were selected
    window: float  #: length of the windows [s]
    law: str  #: that was selected or requested
    by_law: dict[str, AxisEstimate]  #: the fitted laws; the errors of `law` include differences of methods
    expected: tuple[float, float, float]  #: error on held-out blocks [m or N], and its 95 % interval
    findings: tuple[Finding, ...]

    @property
    def best(self) -> AxisEstimate:
        """The estimate by the law that was selected or requested."""
        return self.by_law[self.law]


def identify_axis(
    record: AxisRecord | Sequence[AxisRecord],
    *,
    options: AxisOptions = DEFAULT_OPTIONS,
    known: Mapping[str, float] = MappingProxyType({}),
    validation_records: Sequence[AxisRecord] = (),
    run: Run = DEFAULT_RUN,
) -> AxisIdentification:
    """Identify an axis's mass and friction.

    InputError if the records do not determine the parameters, or the options do not suit them.

    Parameters
    ----------
    record : AxisRecord or sequence of AxisRecord
        Several are fitted together.
    options : AxisOptions, optional
    known : mapping of str to float, optional
        Values of parameters that are not estimated, by name.
    validation_records : sequence of AxisRecord
        Other records of the axis, which are predicted and not fitted.
    run : Run, optional
        Its progress callback is used, its seed is not.

    Examples
    --------
    >>> from ballbot.identification.axis import record_of_rows
    >>> from ballbot.identification.axis.model import Axis
    >>> t = 0.002 * np.arange(6000)
    >>> force = 60.0 * np.sin(4.0 * t) + 30.0 * np.sin(1.7 * t)  # [N]
    >>> slide = Axis(values={"mass": 5.0, "viscous": 8.0, "coulomb": 10.0})
    >>> position = slide.windows(force, 0.002, np.array([0]), np.array([5999]), np.zeros((1, 2)))[:, 0]
    >>> record = record_of_rows("slide", t, force, np.append(0.0, position))
    >>> axis = identify_axis(record, options=AxisOptions(law="coulomb"))
    >>> round(axis.best.values["mass"], 2), round(axis.best.values["coulomb"], 1)  # [kg], [N]
    (5.0, 10.0)
    """
    records = (record,) if isinstance(record, AxisRecord) else tuple(record)
    _check(records, validation_records, options)
    run.progress(Progress(stage="forces"))
    motions, others = ([motion_of(r.thinned()) for r in part] for part in (records, validation_records))
    coulomb, forces = _with_forces(motions, options, known)
    law, duration = options.law, window_duration(motions)
    # a requested law is fitted beside the simpler one
    wanted = [name for name in LAWS if law is None or name in (law, LAWS[law][1] or "coulomb")]
    fits = dict[str, AxisEstimate]()
    for number, name in enumerate(wanted):
        run.progress(Progress(stage=f"law {name}", done=number, total=len(wanted)))
        fits[name] = coulomb if name == "coulomb" else _fit_law(name, coulomb)
    run.progress(Progress(stage="held-out blocks"))
    for name, own in fits.items():
        simpler = fits.get(LAWS[name][1])
        errors = {motion.record.name: own.on(motion, duration) for motion in (*motions, *others)}
        fits[name] = replace(own, errors=errors, gain=own.gain_over(simpler) if simpler else None)
    chosen = law or _selected(fits)
    # a law that is selected must not leave what dry friction would explain
    _check_force(fits[chosen], law or "coulomb")
    _check_range(fits[chosen])
    best, lacks = _widened(fits[chosen])
    expected = _expected(fits[chosen].held_out)
    findings = [note("law", f"The law {chosen} was {'requested' if law else 'selected'}.")]
    findings += [DELTA_HELD] if fits[chosen].fit.moved is not None else []
    findings += [*_another_force(best), *lacks, *_undetermined(best), *_delayed(fits[chosen])]
    findings += _elsewhere(best, expected, [other.name for other in validation_records])
    return AxisIdentification(
        records=tuple(fitted.name for fitted in records),
        unit=records[0].unit,
        forces=forces,
        window=duration,
        law=chosen,
        by_law=fits | {chosen: best},
        expected=expected,
        findings=tuple(findings),
    )


def _check(
    records: Sequence[AxisRecord], validation_records: Sequence[AxisRecord], options: AxisOptions
) -> None:
    names = [record.name for record in (*records, *validation_records)]
    if options.gravity and records[0].unit == "m":
        raise InputError(
            "Gravity on a sliding axis does not vary with its position (--gravity); it is part of the offset."
        )
    if len(set(names)) < len(names):
        raise InputError(
            f"Two of the records have the same name ({', '.join(names)}); give each its own name."
        )
    for record in records:
        if np.ptp(record.force) == 0.0:
            raise InputError(
                f"{record.name}: the force is {record.force[0] + 0.0:g} {record.force_unit} throughout, so nothing can "
                "be identified; check its column and its scale."
            )


def _with_forces(
    motions: Sequence[AxisMotion], options: AxisOptions, known: Mapping[str, float]
) -> tuple[AxisEstimate, dict[str, Gain]]:
    """Return the fit of the law `coulomb`, with gravity and load as requested or selected, and their gains."""
    # uneven rows are not the samples over which a controller holds the force
    uneven = not all(motion.record.even for motion in motions)
    asked = {"gravity": options.gravity, "load": options.load_friction}
    forces = tuple(name for name, wanted in asked.items() if wanted)
    known = known if options.law == "stribeck" else {"stribeck_exponent": 1.0, **known}
    model = AxisModel(law="coulomb", forces=forces, interpolated=uneven, known=known)
    wider = model if options.gravity is not None else with_gravity(motions, model)
    start = inverse_model(motions, wider).values
    if start.get("mass", 1.0) <= 0.0:
        raise InputError(
            f"{motions[0].record.name}: the inverse model estimates a mass of {start['mass']:.3g}, which must be above "
            "zero. The sign of the force or its column is wrong, the force is delayed, or the axis hardly accelerates."
        )
    start = {
        name: value if PARAMETERS[name].scale == "signed" else max(value, 0.0)
        for name, value in start.items()
    }
    gains, fit = dict[str, Gain](), fit_axis(wider, motions, {"load": _LOAD_START, **start})
    # between uneven rows the force is unknown, of which the balance has errors of its own
    fit = fit if uneven else _better_judge(fit)
    model, wider = (replace(one, judge=fit.model.judge) for one in (model, fit.model))

    def if_useful(name: str, fit: AxisEstimate, without: AxisEstimate) -> AxisEstimate:
        """Return the fit with a force if held-out blocks support it, and store its gain; else the one without."""
        gain = fit.gain_over(without)
        if not (_useful(gain) and any(map(fit.is_clear, FORCES[name]))):
            return without
        gains[name] = gain
        return fit

    if wider != model:
        fit = if_useful("gravity", fit, fit_axis(model, motions, fit.values))
    # without gravity, friction under load is part of b and c
    if options.load_friction is None and "gravity" in fit.model.forces:
        wider = replace(fit.model, forces=(*fit.model.forces, "load"))
        fit = if_useful("load", fit_axis(wider, motions, {**fit.values, "load": _LOAD_START}), fit)
    if not uneven:
        # a log slower than its control loop misses changes of the force between rows
        other = fit_axis(replace(fit.model, interpolated=True), motions, fit.values)
        fit = other if other.rms < (1.0 - USEFUL_GAIN) * fit.rms else fit
    return fit, gains


def _better_judge(fit: AxisEstimate) -> AxisEstimate:
    """Return the fit by forces if they show another force, which positions do not contradict; else the fit itself."""
    models = (replace(fit.model, interpolated=between_rows) for between_rows in (False, True))
    explained = max(inverse_model(fit.motions, model).explained for model in models)
    if not _LEAST_EXPLAINED < explained < 1.0 - _ANOTHER_FORCE:
        return fit
    balance = fit_axis(replace(fit.model, judge="force"), fit.motions, fit.values)
    for name, error in balance.standard_errors.items():
        # a law at a bound does not suit; friction that is at one by positions, they do not see
        unseen = np.inf if name in ("viscous", "coulomb") else 0.0
        theirs = np.nan_to_num(fit.standard_errors[name], nan=unseen)
        allowed = CLEAR * np.sqrt(error**2 + theirs**2)  # NaN at a bound by forces, where hypot has infinity
        if not abs(balance.values[name] - fit.values[name]) <= allowed:
            return fit
    return balance


def _useful(gain: Gain | None) -> bool:
    return gain is not None and gain.significant and gain.share >= USEFUL_GAIN


def _fit_law(law: str, coulomb: AxisEstimate) -> AxisEstimate:
    """Fit a law with the forces of a fit of the law `coulomb`, starting from its values."""
    fastest = max(float(np.abs(motion.speed).max()) for motion in coulomb.motions)
    begin = {name: PARAMETERS[name].default for name in LAWS[law][0]} | coulomb.values
    begin["stribeck"] = 0.2 * coulomb.values["coulomb"]
    # a Stribeck speed has several minima
    starts = _STRIBECK_STARTS if law == "stribeck" else _STRIBECK_STARTS[:1]
    model = replace(coulomb.model, law=law)
    fits = [fit_axis(model, coulomb.motions, {**begin, "stribeck_speed": v_s * fastest}) for v_s in starts]
    best = min(fits, key=lambda fit: fit.rms)
    if "stribeck_exponent" not in model.names:
        return best
    wider = axis_experiment(replace(model, held=()), best.motions, window_duration(best.motions))
    own = released(best.fit, wider, "stribeck_exponent", deviation=DELTA_DEVIATION)
    errors = dict(zip(model.names, own.errors.tolist(), strict=True))
    model = replace(model, held=() if own.moved is None else model.held)
    return replace(best, model=model, fit=own, standard_errors=errors)


def _selected(fits: Mapping[str, AxisEstimate]) -> str:
    """Return the law that held-out blocks select."""
    stribeck, coulomb = fits["stribeck"], fits["coulomb"]
    fastest = max(float(np.quantile(np.abs(motion.speed), 0.95)) for motion in stribeck.motions)
    values, errors = stribeck.values, stribeck.standard_errors
    determined = all(errors[name] < values[name] for name in ("stribeck", "stribeck_speed"))
    if _useful(stribeck.gain) and determined and values["stribeck_speed"] < _FADES * fastest:
        return "stribeck"
    # noise of the position, or of a force from elsewhere, may hide friction that is known to a few per cent
    dry = _useful(coulomb.gain) or coulomb.is_clear("coulomb") or _regression_has_dry_friction(coulomb)
    return "coulomb" if dry else "viscous"


def _regression_has_dry_friction(coulomb: AxisEstimate) -> bool:
    """Return whether a plain regression of the force has Coulomb friction, clearly and to some use."""
    without = inverse_model(coulomb.motions, replace(coulomb.model, law="viscous"))
    regression = inverse_model(coulomb.motions, coulomb.model)
    c, error = regression.values["coulomb"], regression.errors["coulomb"]
    return c > CLEAR * error and 1.0 - regression.explained < (1.0 - USEFUL_GAIN) * (1.0 - without.explained)


def _check_force(fit: AxisEstimate, law: str) -> None:
    """Raise InputError if the plain regression of a law explains clearly more of the force than the fit does.

    The fit takes the recorded force for all that drives the axis. Another one moves the simulated positions away from
    the recorded ones, the less the larger the mass, so that the mass becomes far too large.
    """
    inverse, record = inverse_model(fit.motions, replace(fit.model, law=law)), fit.motions[0].record
    left = sum(float(np.sum(_force_left(fit.axis(), m)[m.moving] ** 2)) for m in fit.motions)
    own = 1.0 - left / inverse.squares
    if inverse.explained - own > _CONTRADICTED:
        raise InputError(
            f"{record.name}: the parameters that predict the position best explain {100.0 * max(own, 0.0):.0f} % of "
            f"the force, and a plain regression of the force on acceleration and speed {100.0 * inverse.explained:.0f} "
            f"% ({inverse.text(record.unit)}): something else than this force drives the axis, the supply limits its "
            "speed, the force is late, or it is the friction alone. Record all of the force that drives the axis."
        )


def _check_range(fit: AxisEstimate) -> None:
    """Raise InputError if an estimate of either sign is at the end of its range: offset, gravity or delay."""
    record = fit.motions[0].record
    for name, at_end in zip(fit.model.names, fit.fit.at_bound.tolist(), strict=True):
        kind = PARAMETERS[name]
        if at_end and kind.scale == "signed":
            raise InputError(
                f"{record.name}: {kind.symbol} ({kind.meaning}) fits best at {fit.values[name]:.3g} "
                f"{unit_for(kind, record.unit)}, the end of its range, which no axis exceeds: the force does not drive "
                "this axis throughout, as where the supply limits its speed, or force and position are not of the same "
                "times. Check their columns and clocks."
            )


def _widened(fit: AxisEstimate) -> tuple[AxisEstimate, list[Finding]]:
    """Return the fit with errors that include differences between records and methods, and a finding on these."""
    inverse, motions = inverse_model(fit.motions, fit.model), fit.motions
    others = {"by the inverse model": (inverse.values, inverse.errors)}
    if fit.model.judge == "force":
        by_position = fit_axis(replace(fit.model, judge="position"), motions, fit.values)
        others = {"by positions": (by_position.values, by_position.standard_errors)}
    for number, motion in enumerate(motions if len(motions) > 1 else (), start=1):
        alone = fit_axis(fit.model, [motion], fit.values)
        others[f"in record {number}"] = alone.values, alone.standard_errors
    errors, words = dict(fit.standard_errors), []
    for name, own in fit.standard_errors.items():
        # squared differences beyond chance; a parameter at a bound has no interval
        beyond = [
            ((fit.values[name] - values[name]) ** 2 - theirs[name] ** 2 - np.nan_to_num(own) ** 2, cause)
            for cause, (values, theirs) in others.items()
            if np.isfinite(theirs.get(name, np.nan))
        ]
        most, cause = max(beyond, default=(0.0, ""))
        most = np.sqrt(max(most, 0.0))
        errors[name] = float(np.hypot(own, most))
        if most > CLEAR * own:
            words.append(f"{PARAMETERS[name].symbol} by {most:.2g} {cause}")
    text = (
        "The model may lack an effect: parameters differ by more than chance between records or methods "
        f"({'; '.join(words)}). The 95 % intervals include these differences."
    )
    return replace(fit, standard_errors=errors), [note("discrepancy", text)] if words else []


def _expected(squares: Floats) -> tuple[float, float, float]:
    """Return the error [m or N] of held-out windows with mean squares (w,), and its 95 % interval on a similar one."""
    means = np.array([squares[block].mean() for block in blocks_of(len(squares))])
    drawn = np.sqrt(resamples(len(means), repeats=_DRAWS, seed=_SEED) @ means / len(means))
    middle = float(np.sqrt(squares.mean()))
    # the mean of this record varies as much as that of the other
    factor = float(np.exp(1.96 * np.sqrt(2.0) * np.std(np.log(np.maximum(drawn, 1e-300)))))
    return middle, middle / factor, middle * factor


def _another_force(best: AxisEstimate) -> Iterator[Finding]:
    forces = [motion.force(interpolated=best.model.interpolated)[motion.moving] for motion in best.motions]
    if best.model.judge == "force":
        text = (
            f"Another force acts, as where joints move together: {best.rms:.3g} {best.motions[0].record.force_unit} "
            f"RMS, {100.0 * best.rms / np.std(np.concatenate(forces)):.0f} % of the force, are no function of this "
            "axis's motion by any of the laws. Positions do not distinguish it from friction, so the balance of forces "
            "gives the parameters. Its cause, if known, can be added in a mapping; a longer record narrows the "
            "intervals."
        )
        yield warning("another-force", text, "force")


def _undetermined(best: AxisEstimate) -> Iterator[Finding]:
    for name, error in best.standard_errors.items():
        value, kind = best.values[name], PARAMETERS[name]
        what = f"{kind.symbol} ({kind.meaning})"
        if kind.scale != "signed" and not np.isfinite(error):
            yield warning("at-bound", f"{what} is at its bound, or has no effect: {value:.3g}.")
        elif kind.scale != "signed" and error > abs(value):
            text = f"The records do not determine {what}: its standard error is larger than its value."
            yield warning("undetermined", text)


def _delayed(fit: AxisEstimate) -> Iterator[Finding]:
    """Warn if the force acts later or earlier than its rows."""
    model = replace(fit.model, forces=(*fit.model.forces, "delay"))
    late = fit_axis(model, fit.motions, {**fit.values, "delay": 0.0})
    _check_range(late)
    delay, row = late.values["delay"], max(motion.record.sample_time for motion in fit.motions)
    if late.is_clear("delay") and abs(delay) > 0.5 * row:
        text = (
            f"The force seems to act {1e3 * abs(delay):.2g} ± {1e3 * late.standard_errors['delay']:.2g} ms "
            f"{'later' if delay > 0.0 else 'earlier'} than its rows, as behind a bus or a filter, or the drive yields "
            "or has play: then inertia and viscous friction are off. Shift the force if you know its delay."
        )
        yield warning("force-delay", text)


def _elsewhere(
    best: AxisEstimate, expected: tuple[float, float, float], others: Sequence[str]
) -> Iterator[Finding]:
    """Compare the errors on other records with the expected error."""
    scale, unit = best.model.error_unit(best.motions[0].record.unit)
    middle, low, high = (scale * error for error in expected)
    for name in others:
        error = scale * best.errors[name].window_rmse
        how = "worse than" if error > high else "better than" if error < low else "as"
        interval = f"expected {middle:.3g} ({low:.3g} to {high:.3g})"
        text = f"{name} is predicted {how} expected: {error:.3g} {unit}, {interval}."
        yield finding("other-record", "warning" if error > high else "note", text)
