"""The keys of robot and scenario files and the codes of findings, as one page.

.venv/bin/python -m campaigns.reference     writes docs/generated/reference.md
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from ballbot.files import write_text
from ballbot.findings import CODES
from ballbot.robot import Robot
from ballbot.robot.parameters import DIMENSIONLESS, Parameter, Value, parameters_of
from ballbot.twin import Scenario

PAGE = Path(__file__).parents[1] / "docs" / "generated" / "reference.md"


def page() -> str:
    """Return the page as Markdown."""
    return f"""# Keys and codes

`python -m campaigns.reference` writes this page from the code.

## Keys of a robot file

By their dotted names. [Robot files](../robot_file.md) shows how they are written. An identification
searches within the usual values.

{_parameters(parameters_of(Robot))}
## Keys of a scenario file

Units are SI. [The twin](../twin.md) has an example.

{_parameters(replace(one, written_in=one.unit) for one in parameters_of(Scenario))}
## Codes of findings

`--accept CODE` continues despite an error of that code ([what checks find](../logs.md#what-checks-find)).

{_table(("code", "meaning"), [(f"`{code}`", meaning) for code, meaning in CODES.items()])}"""


def _parameters(parameters: Iterable[Parameter]) -> str:
    rows = [
        (
            f"`{one.name}`",
            one.meaning.replace("|", "\\|"),
            _unit(one),
            _allowed(one),
            _usual(one),
            _default(one.default),
        )
        for one in parameters
    ]
    return _table(("key", "meaning", "unit", "allowed", "usual", "default"), rows)


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _unit(one: Parameter) -> str:
    unit = "" if one.unit == DIMENSIONLESS else one.unit
    return unit if one.written_in == one.unit else f"{unit}; written in {one.written_in}"


def _default(default: Value | str | None) -> str:
    if default is None:
        return ""
    if isinstance(default, tuple):
        return f"`[{', '.join(f'{one:g}' for one in default)}]`" if default else "zeros"
    return f"`{str(default).lower()}`" if isinstance(default, bool | str) else f"`{default:g}`"


def _usual(one: Parameter) -> str:
    return " to ".join(f"{end:g}" for end in one.usual) if math.isfinite(one.usual[0]) else ""


def _allowed(one: Parameter) -> str:
    if one.shape in ("text", "truth value"):
        return one.shape
    if one.least < 0.0:
        return "any" if math.isinf(one.most) else f"-{one.most:.4g} to {one.most:.4g}"
    if math.isinf(one.most):
        return f"{one.least:g} or more" if one.least_is_allowed else "above 0"
    return f"{one.least:g} to {one.most:g}" if one.least_is_allowed else f"above 0, at most {one.most:.4g}"


if __name__ == "__main__":
    write_text(PAGE, page())
