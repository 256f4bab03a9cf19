"""Identify one axis on the public EMPS record and compare the results with the published ones.

.venv/bin/python -m campaigns.evidence one_axis

The record DATA_EMPS.mat is the training record of A. Janot, M. Gautier, M. Brunot, Data set and reference models of
EMPS, 2019. It is not part of Ballbot: put it into the folder emps of a folder that BALLBOT_DATA names.
"""

from __future__ import annotations

from ballbot.findings import texts
from ballbot.identification.axis import AxisIdentification, AxisRecord, identify_axis
from ballbot.identification.axis.identify import Estimate
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from campaigns.section import DataMissingError, Section, data_folder

#: published values and standard deviations
PUBLISHED = {
    "mass": (95.1089, 0.1085),
    "viscous": (203.5034, 1.1460),
    "coulomb": (20.3935, 0.1012),
    "offset": (-3.1648, 0.0444),
}


def emps_record() -> AxisRecord:
    """Return the benchmark's training record, emps/DATA_EMPS.mat in `data_folder`.

    Raises
    ------
    DataMissingError
        If the file is not there.
    """
    path = data_folder() / "emps" / "DATA_EMPS.mat"
    if not path.exists():
        raise DataMissingError(f"it needs the public EMPS record as {path}; see docs/axis.md")
    columns = AxisColumns(
        position="qm",
        force="vir",
        force_scale="gtau",
        reference="qg",
        position_gain="kp",
        velocity_gain="kv",
        limit="10",
    )
    return read_axis_record(path, columns)


def campaign() -> Section:
    """Identify the axis and return the section of docs/generated/evidence.md."""
    found = identify_axis(emps_record())
    inverse = found.inverse["coulomb"]
    rows = [
        ["published (inverse model)", *(f"{v:.4f} ± {s:.4f}" for v, s in PUBLISHED.values()), "", "5.848"]
    ]
    texts = [
        f"{inverse.value(name):.4f} ± {inverse.standard_deviations[inverse.names.index(name)]:.4f}"
        for name in PUBLISHED
    ]
    errors = found.estimate("inverse").errors[0]
    rows.append(
        ["inverse model, as published", *texts, *_errors(errors.open_loop_rmse, errors.closed_loop_force)]
    )
    rows += [_row(f"{one.law.name}, {one.method}", one) for one in found.estimates]
    rows += [
        _row(f"{name}, open loop", one) for name, one in found.by_law.items() if name != found.chosen.name
    ]
    return Section(
        title="One axis: the EMPS benchmark",
        before="24.84 s at 1 kHz of an electro-mechanical positioning system, its position and its motor's voltage. In "
        "the first two rows the standard errors treat samples as independent, as published; below they are clustered "
        "in time. Open "
        "loop: RMS position error over the whole record [mm]; closed loop: relative force error [%].",
        columns=["law and method", "M [kg]", "b [N s/m]", "c [N]", "offset [N]", "open loop", "closed loop"],
        rows=rows,
        after=_after(found),
    )


def _row(name: str, one: Estimate) -> list[str]:
    texts = []
    for parameter in PUBLISHED:
        if parameter in one.values:
            texts.append(f"{one.values[parameter]:.4g} ± {one.standard_errors[parameter]:.2g}")
        elif f"{parameter}_plus" in one.values:
            texts.append(f"{one.values[f'{parameter}_plus']:.4g} / {one.values[f'{parameter}_minus']:.4g}")
        else:
            texts.append("")
    errors = one.errors[0]
    return [name, *texts, *_errors(errors.open_loop_rmse, errors.closed_loop_force)]


def _errors(rmse: float, force: float | None) -> list[str]:
    return [f"{1e3 * rmse:.2f}", "" if force is None else f"{100.0 * force:.2f}"]


def _after(found: AxisIdentification) -> str:
    gains = "; ".join(
        f"{one.name} over {one.within} {100.0 * one.gain.share:.0f} % "
        f"({100.0 * one.gain.lower:.0f} to {100.0 * one.gain.upper:.0f})"
        for one in found.ladder.candidates
        if one.gain
    )
    remarks = " ".join(texts(found.remarks))
    return f"Less error on windows of 1 s held out, with 95 % intervals: {gains}. {remarks}"
