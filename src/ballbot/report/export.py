"""An exported firmware as text: what it is for, how much it takes, and when its safety layer stops."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.text import Text

from ballbot.control.controller import Controller
from ballbot.firmware.export import Export
from ballbot.report.console import table


def export_parts(exported: Export, controller: Controller, *, framed: bool) -> Iterator[RenderableType]:
    """Yield the controller, sizes and limits of an exported firmware."""
    limits = exported.limits
    parts = ", ".join(part.label for _, part in controller.parts.present()) or "none"
    compensation = "no" if controller.compensation == "none" else controller.compensation
    yield Text(
        f"{len(exported.files)} files for {controller.robot.name}. Estimator: {controller.estimator}; {compensation} "
        f"friction compensation; parts: {parts}."
    )
    rows = [
        ["period", f"{1e3 * controller.sample_time:g} ms"],
        ["numbers of the controller (flash)", f"{exported.parameter_bytes} bytes"],
        ["state (RAM)", f"{exported.state_bytes} bytes"],
        ["torque limit", f"{controller.torque_limit:.3g} N m"],
        ["stops beyond a lean of", f"{limits.lean:g} rad"],
        ["stops if a sample comes after more than", f"{1e3 * limits.max_interval:g} ms"],
        ["stops after missing samples", f"{limits.max_missing + 1}"],
        ["stops if a sensor repeats itself for", f"{limits.max_unchanged} samples"],
        ["a wheel must turn under", f"{limits.turning_torque:.3g} N m"],
    ]
    yield table("firmware", ("quantity", "value"), rows, framed=framed)
