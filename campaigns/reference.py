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

{_parameters(replace(part, written_in=part.unit) for part in parameters_of(Scenario))}
## Codes of findings

`--accept CODE` continues despite an error of that code ([what checks find](../logs.md#what-checks-find)).

{_table(("code", "meaning"), [(f"`{code}`", meaning) for code, meaning in CODES.items()])}"""


def _parameters(parameters: Iterable[Parameter]) -> str:
    rows = [
        (
            f"`{parameter.name}`",
            parameter.meaning.replace("|", "\\|"),
            _unit(parameter),
            _allowed(parameter),
            _usual(parameter),
            _default(parameter.default),
        )
        for parameter in parameters
    ]
    return _table(("key", "meaning", "unit", "allowed", "usual", "default"), rows)


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _unit(parameter: Parameter) -> str:
    unit = "" if parameter.unit == DIMENSIONLESS else parameter.unit
    return unit if parameter.written_in == parameter.unit else f"{unit}; written in {parameter.written_in}"


def _default(default: Value | str | None) -> str:
    if default is None:
        return ""
    if isinstance(default, tuple):
        return f"`[{', '.join(f'{number:g}' for number in default)}]`" if default else "zeros"
    return f"`{str(default).lower()}`" if isinstance(default, bool | str) else f"`{default:g}`"


def _usual(parameter: Parameter) -> str:
    return " to ".join(f"{end:g}" for end in parameter.usual) if math.isfinite(parameter.usual[0]) else ""


def _allowed(parameter: Parameter) -> str:
    if parameter.shape in ("text", "truth value"):
        return parameter.shape
    if parameter.least < 0.0:
        return "any" if math.isinf(parameter.most) else f"-{parameter.most:.4g} to {parameter.most:.4g}"
    if math.isinf(parameter.most):
        return f"{parameter.least:g} or more" if parameter.least_is_allowed else "above 0"
    return (
        f"{parameter.least:g} to {parameter.most:g}"
        if parameter.least_is_allowed
        else f"above 0, at most {parameter.most:.4g}"
    )


if __name__ == "__main__":
    write_text(PAGE, page())
