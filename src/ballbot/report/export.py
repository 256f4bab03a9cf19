"""The page of an exported firmware: its controller, its load on the processor, and when its safety layer stops."""

from collections.abc import Sequence

from ballbot.control.controller import Controller, torque_limit_words
from ballbot.findings import Finding
from ballbot.firmware.emulator import CYCLES
from ballbot.firmware.export import Export
from ballbot.firmware.processor_load import ProcessorLoad
from ballbot.firmware.records import FIRMWARE
from ballbot.report.blocks import Result, Sheet, section

_HEADINGS = ("quantity", "value")


def export_report(
    exported: Export,
    controller: Controller,
    load: ProcessorLoad | None,
    *,
    to_install: str,
    findings: Sequence[Finding],
) -> Result:
    """Return the page of an exported firmware; `to_install` names what measuring the load needs."""
    robot, limits, weights = controller.robot, exported.limits, exported.weight_bytes
    parts = ", ".join(part.label for _, part in controller.parts.present()) or "none"
    compensation = "no" if controller.compensation == "none" else controller.compensation
    about = (
        f"{len(exported.files)} files for {robot.name}. Estimator: {controller.estimator}; {compensation} "
        f"friction compensation; parts: {parts}."
    )
    rows = [
        ("period", f"{1e3 * controller.sample_time:g} ms"),
        ("parameters of the controller (flash)", f"{exported.parameter_bytes} bytes"),
        *([("weights of the policy (flash)", f"{weights} bytes")] if weights else []),
        ("state (RAM)", f"{exported.state_bytes} bytes"),
        ("torque limit", torque_limit_words(controller)),
        ("stops beyond a lean of", f"{limits.lean:g} rad"),
        ("stops if a sample takes longer than", f"{1e3 * limits.max_interval:g} ms"),
        ("stops after missing", f"{limits.max_missing + 1} samples in a row"),
        ("stops if a sensor repeats itself for", f"{limits.max_unchanged} samples"),
        ("stops if a wheel does not turn under", f"{limits.turning_torque:.3g} N m"),
    ]
    worst = load and (
        f"The worst update takes at most {load.worst_cycles:,} cycles, {100.0 * load.worst_share:.1f} % of the period "
        f"of {1e3 * load.period:g} ms at {load.clock / 1e6:g} MHz."
    )
    return Result(
        title=f"{robot.name}: a controller as firmware",
        lead="In C99; README.md says how to build it.",
        verdict=[
            ("Firmware", about),
            ("Gains", exported.gains.sentence() if exported.gains else ""),
            ("Processor", worst or ""),
        ],
        sections=[
            section("The controller", Sheet(_HEADINGS, rows)),
            section("On the processor", _processor_sheet(load) if load else None),
        ],
        undecided=[
            "What interrupts and drivers of a board take: they come on top of the library's cycles."
            if load
            else f"What an update takes on the processor. {to_install}",
            "Whether motors, encoders and IMU are wired as the library expects: the self-test of README.md checks it.",
        ],
        findings=findings,
        data={
            "robot": robot.name,
            "estimator": controller.estimator,
            "sample_time": controller.sample_time,
            "safety": limits,
            "schema": FIRMWARE.digest,
            "parameter_bytes": exported.parameter_bytes,
            "weight_bytes": weights,
            "state_bytes": exported.state_bytes,
            "gains": exported.gains
            and {"robots_and_delays": len(exported.gains.loops), "growth": exported.gains.growth},
            "processor": load,
        },
    )


def _processor_sheet(load: ProcessorLoad) -> Sheet:
    fix = load.fix_instructions
    rows = [
        ("instructions of an update, typical", f"{load.typical_instructions:,}"),
        ("instructions of an update, worst", f"{load.worst_instructions:,}"),
        ("cycles, worst, at most", f"{load.worst_cycles:,}"),
        *([] if fix is None else [("instructions, worst, with a fix of the pose", f"{fix:,}")]),
        ("share of the period, worst", f"{100 * load.worst_share:.1f} %"),
        ("highest rate", f"{load.highest_rate:,.0f} Hz"),
        ("flash: library, robot.c and numbers", f"{load.flash:,} bytes"),
        ("RAM: struct robot", f"{load.ram:,} bytes"),
        ("stack of robot_step, at most", f"{load.stack:,} bytes"),
    ]
    caption = (
        f"Measured over {load.samples} samples on an emulated Cortex-M4F, the library compiled by Clang with -O2 "
        f"({load.compiler}). Instructions are exact; cycles are an upper estimate, {CYCLES:g} for each instruction "
        "in flash with two wait states."
    )
    return Sheet(_HEADINGS, rows, caption)
