"""Count how often the 95 % intervals of an axis contain the truth, of drives that are rigid, yield or have play.

.venv/bin/python -m campaigns.evidence axis_intervals

The machines are those of campaigns/axis_machines.py, each with three motions and two loggers. The steps are those of
`identify_axis` with the law coulomb, without the other laws and the comparison of methods, which take most of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from scipy.stats import binomtest

from ballbot.identification.axis import AXIS_LAWS, AxisOptions, AxisRecord
from ballbot.identification.axis.discrepancy import discrepancy_of, with_discrepancy
from ballbot.identification.axis.law_fits import fit_law
from ballbot.identification.axis.preparation import Bench, prepared_with_windows
from ballbot.identification.axis.result import Estimate
from campaigns.axis_machines import Drive, Logging, Machine, Motion, record_of
from campaigns.section import Section

#: not those that the method was developed on
SEEDS = range(100, 107)
DURATION = 8.0  #: of a record [s]
#: the parameters that are judged, with their symbols
SYMBOLS = {"mass": "M", "viscous": "b", "coulomb": "c"}
#: by name, the loggers: one that runs with the loop, and one that is slower and whose rows jitter
LOGGERS = {
    "16 bits": Logging(duration=DURATION, rate=200.0, counts=2.0**16, slowest=0.2, fastest=1.2),
    "12 bits, uneven": Logging(
        duration=DURATION, rate=200.0, counts=2.0**12, slowest=0.2, fastest=1.2, held=False, jitter=0.4
    ),
}
MACHINES = ("slide", "pendulum", "play", "elastic")
MOTIONS: tuple[Motion, ...] = get_args(Motion)


def draw(kind: str, logging: Logging, seed: int) -> tuple[Machine, Logging]:
    """Return a random machine of a kind, and how it is moved and recorded."""
    random = np.random.default_rng([seed, *kind.encode()])
    slides = kind == "slide"
    mass = 10.0 ** random.uniform(-1.0, 1.0)
    dry = mass * random.uniform(1.0, 4.0) * (0.3 if slides else 1.0)
    machine = Machine(
        kind="cart" if slides else kind,
        inertia=mass,
        viscous=dry * random.uniform(0.2, 1.0) * (3.0 if slides else 1.0),
        coulomb=dry,
        offset=dry * random.uniform(-0.2, 0.2),
        gravity=(mass * random.uniform(4.0, 12.0), 0.0) if kind == "pendulum" else (0.0, 0.0),
    )
    share = random.uniform(0.3, 0.6)
    if kind == "play":
        drive = Drive(share=share, natural=80.0, damping=0.1, play=random.uniform(5e-4, 4e-3))
        machine = replace(machine, drive=drive)
    elif kind == "elastic":
        machine = replace(machine, drive=Drive(share=share, natural=random.uniform(15.0, 40.0)))
    amplitude = random.uniform(0.2, 0.4) if slides else random.uniform(0.8, 1.5)
    return machine, replace(logging, amplitude=amplitude, force_noise=0.02 * dry)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What one record gave of each parameter, as shares of the truth."""

    errors: dict[str, float]
    alone: dict[str, float]  #: half widths of the 95 % intervals from the standard errors alone
    whole: dict[str, float]  #: and with what the model lacks


def estimate_of(record: AxisRecord) -> tuple[Estimate, Estimate]:
    """Return the result of a record with the intervals of the standard errors alone, and with the discrepancies."""
    bench = Bench(records=(record,), others=(), bandwidth=None)
    _, needed, blocks, horizon = prepared_with_windows(bench, AxisOptions(law="coulomb"))
    chosen = horizon.chosen
    seen = needed.bench.sightings
    model = needed.model.with_law(AXIS_LAWS["coulomb"])
    fit = fit_law(model, needed.starts["coulomb"], None, seen, blocks, chosen)
    alone = needed.bench.estimate("open loop", fit, chosen)
    lacking = discrepancy_of(fit, seen, blocks, chosen)
    return alone, with_discrepancy(alone, lacking.errors, fit.quantile)


def trial(kind: str, logger: str, motion: Motion, seed: int) -> Trial:
    """Identify one machine from one record."""
    machine, logging = draw(kind, replace(LOGGERS[logger], motion=motion), seed)
    alone, whole = estimate_of(record_of(machine, logging, seed))
    truth = {"mass": machine.inertia, "viscous": machine.viscous, "coulomb": machine.coulomb}
    return Trial(
        errors={name: alone.values[name] / value - 1.0 for name, value in truth.items()},
        alone={name: alone.half_widths[name] / value for name, value in truth.items()},
        whole={name: whole.half_widths[name] / value for name, value in truth.items()},
    )


def campaign() -> Section:
    """Identify the machines and return the section of docs/generated/evidence.md."""
    rows = []
    for logger in LOGGERS:
        for kind in MACHINES:
            done = [trial(kind, logger, motion, seed) for seed in SEEDS for motion in MOTIONS]
            rows.append([f"{kind}, {logger}", *_row(done)])
    motions = ", ".join(MOTIONS[:-1])
    return Section(
        title="One axis: coverage of the intervals",
        before=f"Simulated machines (campaigns/axis_machines.py, drawn in campaigns/axis_intervals.py): records of "
        f"{DURATION:g} s at 200 Hz, {len(SEEDS)} seeds with each of {len(MOTIONS)} motions ({motions} and "
        f"{MOTIONS[-1]}). A slide and a pendulum have rigid drives; the others drive 30 to 60 % of the inertia by "
        "gears with a play of 0.5 to 4 mrad to either side, or by an elastic shaft (15 to 40 Hz). The uneven log "
        "comes from a loop at 1 kHz. Of mass M, viscous friction b and Coulomb friction c: how many 95 % intervals "
        "from the standard errors alone contain the truth, and how many with the errors by what the model lacks, with "
        "the 95 % interval of that share (Clopper and Pearson); and the median error and half width, as shares of the "
        "truth.",
        columns=["machine and logger", *(f"{one} {what}" for one in SYMBOLS.values() for what in _COLUMNS)],
        rows=rows,
    )


_COLUMNS = ("alone", "with discrepancy", "error, half width [%]")


def _row(done: Sequence[Trial]) -> list[str]:
    texts = []
    for name in SYMBOLS:
        errors = np.abs([one.errors[name] for one in done])
        whole = np.array([one.whole[name] for one in done])
        within = int(np.sum(errors <= np.array([one.alone[name] for one in done])))
        inside = int(np.sum(errors <= whole))
        share = binomtest(inside, len(done)).proportion_ci()
        error, half = (100.0 * float(np.median(one)) for one in (errors, whole))
        texts += [
            f"{within} of {len(done)}",
            f"{inside} of {len(done)} ({100.0 * share.low:.0f} to {100.0 * share.high:.0f} %)",
            f"{error:.2g}, {half:.2g}",
        ]
    return texts
