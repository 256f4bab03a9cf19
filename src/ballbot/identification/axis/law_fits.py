"""Every friction law of an axis, fitted to windows in open loop.

Single events of sticking make several minima of the windows' error, and a descent finds the one nearest to its start.
So the better of two descents is taken: from the inverse model's parameters, and from the fit of the law within. A law
contains the one within it, so that its least error is not above that one's: if a fit's is, it is fitted again from the
parameters at which both laws are the same. Bristles are no limit of Coulomb friction here: stiff ones bend within one
step of the simulation, which does not resolve it. What other methods find may be a better start still (`improved`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from scipy.optimize import lsq_linear

from ballbot.errors import InputError
from ballbot.fitting.run import Run
from ballbot.identification.axis.inverse import InverseFit, break_away_column, inverse_fit, regression_rows
from ballbot.identification.axis.laws import AXIS_LAWS, PARAMETERS, Values, unit_for
from ballbot.identification.axis.output_error import OutputErrorFit, Sighting
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.selection import SAME, Blocks, at_constant_speed, fit_all, problem_of
from ballbot.identification.axis.structure import AxisModel, base_name
from ballbot.progress import Progress

#: where a search starts: the bristles' travel over the record's, the break-away's share of Coulomb friction
_BRISTLE_TRAVEL, _BREAK_AWAY = 4e-4, 0.1
#: and other values that are tried there, as shares of these
_FACTORS = {"stribeck": (1.0, 3.0), "stribeck_speed": (1.0, 0.3), "stiffness": (1.0, 0.1, 10.0)}
#: Stribeck speeds over the usual one that are tried in the inverse model; it shows a break-away force if that lowers
#: its squared error to less than this share
_STRIBECK_SPEEDS, _CLEARLY = (0.03, 0.1, 0.3, 1.0), 0.9
#: coefficients that cannot be below zero
_DISSIPATES = ("viscous", "coulomb", "stribeck", "load")
#: shares of the usual force: a dry friction to start from at least, and one where a law is all but the one within it
_LEAST_FRICTION, _NO_FRICTION = 1e-3, 1e-4
#: a law's error is below this share of that of a constant speed, if the records determine it
_INFORMATIVE = 0.9


def initial_values(
    sightings: Sequence[Sighting], model: AxisModel, *, bandwidth: float | None
) -> dict[str, dict[str, float]]:
    """Return the inverse model's parameters for each law, and for those that it does not have where a search begins."""
    records = [one.record for one in sightings]
    fits = {
        form: inverse_fit(records, model=model.with_law(AXIS_LAWS[form]), bandwidth=bandwidth, moving=True)
        for form in ("coulomb", "asymmetric")
    }
    least = _LEAST_FRICTION * max(one.usual_force for one in records)
    travel = max(float(np.ptp(one.position)) for one in records)
    found = {}
    for name, law in AXIS_LAWS.items():
        own, fit = model.with_law(law), fits["coulomb" if law.symmetric else "asymmetric"]
        values = fit.by_name
        for label in fit.names:
            base = base_name(label)
            if base == "mass":
                values[label] = _initial_mass(records[0], fit, label)
            elif base.startswith(("viscous", "coulomb")):
                values[label] = max(values[label], least)
            elif base == "load":
                values[label] = max(values[label], _LEAST_FRICTION)
        dry = max(values.get("coulomb", least), least)
        stiffness = dry / (model.bending or _BRISTLE_TRAVEL * travel)
        extra = {
            "stiffness": stiffness,
            "stribeck": _BREAK_AWAY * dry,
            "stribeck_speed": sightings[0].usual_speed / 5.0,
            "micro_damping": 0.1 * float(np.sqrt(stiffness * abs(values.get("mass", 1.0)))),
        }
        if "stribeck" in law.names:
            extra |= _break_away(sightings, model, bandwidth=bandwidth)
            values |= {label: extra[label] for label in values if label in extra}
        found[name] = {label: values.get(label, extra.get(base_name(label), 0.0)) for label in own.labels}
    return found


def _break_away(
    sightings: Sequence[Sighting], model: AxisModel, *, bandwidth: float | None
) -> dict[str, float]:
    """Return the inverse model's parameters with a break-away force, at the best of some Stribeck speeds.

    Empty if none of them lowers the force error by `_CLEARLY` without a coefficient of friction below zero.
    """
    rows = regression_rows(
        [one.record for one in sightings],
        model.with_law(AXIS_LAWS["coulomb"]),
        bandwidth=bandwidth,
        moving=True,
    )
    speed, base = rows.seen["speed"], np.column_stack(list(rows.columns.values()))
    names = (*rows.columns, "stribeck")
    least = np.array([0.0 if base_name(name) in _DISSIPATES else -np.inf for name in names])
    best, found = _CLEARLY * lsq_linear(base, rows.force, (least[:-1], np.inf)).cost, {}
    for share in _STRIBECK_SPEEDS:
        slowest = share * sightings[0].usual_speed
        column = break_away_column(speed, slowest)
        fit = lsq_linear(np.column_stack([base, column]), rows.force, (least, np.inf))
        if fit.cost < best:
            best = fit.cost
            found = dict(zip(names, fit.x.tolist(), strict=True)) | {"stribeck_speed": slowest}
    return found if found.get("mass", 1.0) > 0.0 else {}


def _initial_mass(record: AxisRecord, fit: InverseFit, label: str) -> float:
    """Return a mass above zero to start from."""
    place = fit.names.index(label)
    mass, error = float(fit.values[place]), float(fit.clustered_errors[place])
    if mass <= 0.0 and record.known_load.inertia == 0.0 and not abs(mass) < 3.0 * error:
        raise InputError(
            f"{record.name}: the inverse model estimates a mass of {mass:.3g}. "
            "The sign of the force or its column is wrong, or the axis hardly accelerates."
        )
    return max(mass, 0.3 * error, 0.02 * record.known_load.inertia)


def fit_laws(
    model: AxisModel,
    starts: Mapping[str, dict[str, float]],
    sightings: Sequence[Sighting],
    blocks: Blocks,
    horizon: float,
    run: Run,
) -> dict[str, OutputErrorFit]:
    """Return every law fitted to windows of that length.

    Raises
    ------
    InputError
        If the records determine no law; see `check_determined`.
    """
    fits: dict[str, OutputErrorFit] = {}
    for number, (name, law) in enumerate(AXIS_LAWS.items()):
        run.progress(Progress(stage=f"open loop, law {name}", done=number, total=len(AXIS_LAWS)))
        own, inner = model.with_law(law), fits.get(law.below or "")
        fits[name] = fit_law(own, starts[name], inner, sightings, blocks, horizon)
    closest = min(fits.values(), key=lambda one: one.rms)
    check_determined(closest, starts["coulomb"], sightings, blocks, horizon)
    return fits


def fit_law(
    model: AxisModel,
    start: Values,
    inner: OutputErrorFit | None,
    sightings: Sequence[Sighting],
    blocks: Blocks,
    horizon: float,
) -> OutputErrorFit:
    """Return the best fit of a law, from `start` and from the fit of the law within it."""
    begins = [{**start}]
    # the viscous law's mass and damping stand for dry friction too, and are no start of another law
    if inner is not None and "coulomb" in inner.values:
        begins.append({**start, **_shared(model, inner)})
    problem = problem_of(model, sightings, blocks, horizon)
    fits = [
        fit_all(model, min(_shapes(one, inner), key=problem.rms), sightings, blocks, horizon)
        for one in begins
    ]
    best = min(fits, key=lambda one: one.rms)
    fit = fit_all(model, best.values, sightings, blocks, horizon, restarts=1)
    if inner is None or ("stiffness" in model.law.names and "stiffness" not in inner.model.law.names):
        return fit
    if problem.rms(fit.values) <= (1.0 + SAME) * problem_of(inner.model, sightings, blocks, horizon).rms(
        inner.values
    ):
        return fit
    begin = {**start, **_shared(model, inner), **_without_effect(fit, inner, sightings)}
    again = fit_all(model, begin, sightings, blocks, horizon)
    return min(fit, again, key=lambda one: problem.rms(one.values))


def _shapes(start: Values, inner: OutputErrorFit | None) -> list[dict[str, float]]:
    """Return starts with other values of the parameters that shape a law and are not those of the law within it."""
    known = set() if inner is None else {base_name(label) for label in inner.values}
    factors = {
        label: _FACTORS[base_name(label)] for label in start if base_name(label) in {*_FACTORS} - known
    }
    return [
        {**start, **{label: start[label] * factor for label, factor in zip(factors, some, strict=True)}}
        for some in product(*factors.values())
    ]


def _shared(model: AxisModel, inner: OutputErrorFit) -> dict[str, float]:
    """Return a fit's parameters as a wider law has them, those at zero left out."""
    found = dict(inner.values)
    if not model.law.symmetric:
        offset = float(np.mean([v for k, v in inner.values.items() if base_name(k) == "offset"]))
        for label in model.labels:
            base, bracket, number = label.partition("[")
            kind, _, way = base.partition("_")
            if way in ("plus", "minus"):
                value = inner.values.get(f"{kind}{bracket}{number}", inner.values.get(kind, 0.0))
                if kind == "coulomb":
                    value += offset if way == "plus" else -offset
                found[label] = value
    signed = {label for label in model.labels if model.parameter(label).scale == "signed"}
    return {
        label: found[label]
        for label in model.labels
        if found.get(label, 0.0) > 0.0 or label in signed & {*found}
    }


def improved(
    fit: OutputErrorFit,
    others: Sequence[Values],
    sightings: Sequence[Sighting],
    blocks: Blocks,
    horizon: float,
) -> OutputErrorFit:
    """Return a fit, or one from the best of other parameters of its law if their error is below the fit's."""
    problem = problem_of(fit.model, sightings, blocks, horizon)
    best = min((fit.values, *others), key=problem.rms)
    if not problem.rms(best) < (1.0 - SAME) * problem.rms(fit.values):
        return fit
    found = fit_all(fit.model, best, sightings, blocks, horizon, restarts=1)
    # a descent keeps the starts of its windows, and may end above where it began
    return min(fit, found, key=lambda one: problem.rms(one.values))


def check_determined(
    fit: OutputErrorFit, inverse: Values, sightings: Sequence[Sighting], blocks: Blocks, horizon: float
) -> None:
    """Refuse a fit that predicts windows no better than an axis that goes on at the speed of their start.

    The message gives the inverse model's parameters of the law coulomb.

    Nothing in such windows depends on the mass or the friction: the axis hardly accelerates in them, or it is unstable
    without its loop, as at low speed, where friction that falls with speed drives it.

    Raises
    ------
    InputError
        If the error is not below `_INFORMATIVE` of that of a constant speed.
    """
    going_on = at_constant_speed(len(sightings))
    constant = problem_of(going_on.model, sightings, blocks, horizon).rms(going_on.values)
    error = problem_of(fit.model, sightings, blocks, horizon).rms(fit.values)
    if error < _INFORMATIVE * constant:
        return
    first, unit = sightings[0].record, sightings[0].record.unit
    found = ", ".join(
        f"{PARAMETERS[name].symbol} = {inverse[name]:.3g} {unit_for(PARAMETERS[name], unit)}"
        for name in ("mass", "viscous", "coulomb")
        if name in inverse
    )
    raise InputError(
        f"{first.name} does not determine mass and friction: over windows of {horizon:g} s the recorded force "
        f"predicts the position with an error of {1e3 * error:.3g} m{unit}, a constant speed with "
        f"{1e3 * constant:.3g}. Record faster motions that accelerate more, with fewer rests and less motion at low "
        f"speed.{f' The inverse model, which noise biases, gives {found}.' if found else ''}"
    )


def _without_effect(
    fit: OutputErrorFit, inner: OutputErrorFit, sightings: Sequence[Sighting]
) -> dict[str, float]:
    """Return a law's own parameters at which it is all but the law within it."""
    force = max(one.record.usual_force for one in sightings)
    effect = {
        "coulomb": force * _NO_FRICTION,
        "stribeck": force * _NO_FRICTION,
        "micro_damping": 1e-12 * force / sightings[0].usual_speed,
    }
    return {
        label: effect[base_name(label)]
        for label in fit.values
        if base_name(label) in effect and base_name(label) not in inner.model.law.names
    }
