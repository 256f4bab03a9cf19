"""The keys of robot and scenario files and the codes of findings, as one page.

.venv/bin/python -m campaigns.reference     writes docs/generated/reference.md
"""

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
            f"`{key.name}`",
            key.meaning.replace("|", "\\|"),
            _unit(key),
            _allowed(key),
            _usual(key),
            _default(key.default),
        )
        for key in parameters
    ]
    return _table(("key", "meaning", "unit", "allowed", "usual", "default"), rows)


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _unit(key: Parameter) -> str:
    unit = "" if key.unit == DIMENSIONLESS else key.unit
    return unit if key.written_in == key.unit else f"{unit}; written in {key.written_in}"


def _default(default: Value | str | None) -> str:
    if default is None:
        return ""
    if isinstance(default, tuple):
        return f"`[{', '.join(f'{number:g}' for number in default)}]`" if default else "zeros"
    return f"`{str(default).lower()}`" if isinstance(default, bool | str) else f"`{default:g}`"


def _usual(key: Parameter) -> str:
    return " to ".join(f"{end:g}" for end in key.usual) if math.isfinite(key.usual[0]) else ""


def _allowed(key: Parameter) -> str:
    if key.shape in ("text", "truth value"):
        return key.shape
    if key.least < 0.0:
        return "any" if math.isinf(key.most) else f"-{key.most:.4g} to {key.most:.4g}"
    if math.isinf(key.most):
        return f"{key.least:g} or more" if key.least_is_allowed else "above 0"
    return f"{key.least:g} to {key.most:g}" if key.least_is_allowed else f"above 0, at most {key.most:.4g}"


if __name__ == "__main__":
    write_text(PAGE, page())
