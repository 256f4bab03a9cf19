"""The C of the control law and of attitudes: which functions of Python it is written from, and into which files.

    c/parts/part.h       what the parts share: `ballbot.control.parts.part`
    c/parts/steps.h      the steps of these parts
    c/parts/NAME.c       a part, from the file of that name
    c/parts/tuning.c, c/decide.c     from `tuning` and `law`
    c/estimation/heading.c, swing.c, slip.c, onboard.c, known.h     from the modules of these names

By hand are the policy, whose network has its size from its weights, and `law.c`, which looks at state and reference.
`tests.support.python_to_c` translates; `tests.support.firmware_headers` writes the files.
"""

import math
from functools import cache
from types import ModuleType

from ballbot.control import law, tuning
from ballbot.control.parts import (
    compensation,
    disturbance_observer,
    feed_forward,
    integral,
    lean_limit,
    notch,
    part,
    planner,
    policy,
    prediction,
    turning,
)
from ballbot.errors import InputError
from ballbot.estimation import heading, known, onboard, slip, swing
from ballbot.estimation.kalman_model import KALMAN
from ballbot.firmware.estimators import READING
from ballbot.mechanics.engine import compensated_sum
from ballbot.mechanics.engine.elementary import sine_cosine
from ballbot.mechanics.floor import rolling_brake
from ballbot.mechanics.friction import decay, with_stribeck
from tests.support.python_to_c import NOTHING, REAL, TRUTH, WHOLE, External, Program, Type, record, values

#: functions of C that are written by hand
EXTERNALS = {
    abs: External("ballbot_magnitude"),
    sine_cosine: External("ballbot_sine_cosine", outputs=True),
    known.not_a_number.py_func: External("ballbot_not_a_number"),
    compensated_sum.add_to.py_func: External(
        "ballbot_add(&{0}[{2}], &{1}[{2}], {3})", NOTHING, written=(0, 1)
    ),
    rolling_brake: External("{0} / ballbot_larger({1}, 1e-30f)"),
    math.atan2: External("ballbot_arctangent"),
    decay: External("ballbot_exponential(-ballbot_power({0}, {1}))"),
    with_stribeck: External("({0} + {1} * {2})"),
    policy.act.py_func: External("ballbot_act", NOTHING, written=(1,)),
    policy.within_policy.py_func: External("ballbot_within_policy", TRUTH),
    policy.with_policy.py_func: External("ballbot_with_policy"),
}
#: constants by their names in Python
NAMES = {
    "MAX_WHEELS": "BALLBOT_MAX_WHEELS",
    "SPEEDS": "BALLBOT_TABLE_SPEEDS",
    "_NUMBERS": "BALLBOT_TUNING_NUMBERS",
    "_COMPENSATION": "BALLBOT_TUNING_COMPENSATION",
    "BIAS": "B_X",
    "G": "G_X",
    "S": "S_X",
    **{name: name for name in ("PSI", "SHOWN_PSI", "X", "PIVOTING_SEEN")},
}
#: the parts that are written; not the policy
PARTS = (tuning, disturbance_observer, prediction, turning, planner, feed_forward, lean_limit, integral,
         compensation, notch)  # fmt: skip
_NUMBERS, _GYRO = Type("float", ("10",)), Type("float", ("3",))
_LEVER, _STATES = Type("float", ("2", "3")), Type("float", ("STATES",))


@cache
def program() -> Program:
    """Return the law, the filter's attitudes, and all that they call."""
    made = Program(externals=EXTERNALS, names=NAMES)
    arguments = [
        record(law.LAW),
        record(law.MEMORY),
        NOTHING,
        _NUMBERS,
        _NUMBERS,
        Type("float", ("",)),
        WHOLE,
    ]
    made.add(law.decide, arguments)
    made.add(swing.swing_of, [REAL] * 3)
    made.add(swing.begin_filter, [_LEVER, values(swing.SwingTwist), _GYRO, _STATES])
    made.add(swing.robot_state, [_LEVER, _STATES, _GYRO, _NUMBERS])
    turning = values(onboard.AngularVelocity)
    made.add(slip.without_slip, [record(KALMAN), record(slip.SLIP), REAL, _STATES, _GYRO, turning, WHOLE])
    made.add(known.are_known, [Type("float", ("",)), WHOLE])
    of_onboard = record(onboard.ONBOARD), record(onboard.ONBOARD_MEMORY)
    made.add(onboard.onboard_reset, [of_onboard[1], Type("float", ("2",))])
    made.add(onboard.onboard_update, [*of_onboard, WHOLE, record(READING), _NUMBERS])
    return made


def _plain_name(module: ModuleType) -> str:
    return module.__name__.rpartition(".")[2]


def _file(modules: tuple[ModuleType, ...], comment: str, body: str, guard: str = "") -> str:
    """Return the text of a file."""
    sources = f"{modules[0].__name__.replace('.', '/')}.py" if len(modules) == 1 else "ballbot/control"
    words = comment.replace("`", "").rstrip()
    lines = "".join(f" * {line}".rstrip() + "\n" for line in words.split("\n"))
    given = f"Generated from {sources} by\n * `python -m tests.support.firmware_headers`; do not edit."
    begin = f"/* {given}\n *\n{lines} */\n"
    if guard:
        return f"{begin}#ifndef {guard}\n#define {guard}\n\n{body}\n#endif\n"
    return f"{begin}{body}"


def law_files() -> dict[str, str]:
    """Return the text of each file, by its path in the sources."""
    made = program()
    if unknown := {one.module for one in made.functions.values()} - {
        *(part, heading, swing, slip, known, onboard, law),
        *PARTS,
    }:
        names = ", ".join(sorted(one.__name__ for one in unknown))
        raise InputError(f"{names}: name it in PARTS, so that its C is written.")
    own = "".join(f'#include "{name}.h"\n' for name in ("ballbot_math", "ballbot_types", "compensated_sum"))
    shared = f"#include <stdbool.h>\n\n{own}\n"
    steps = "\n".join(made.declarations(one) for one in PARTS)
    files = {
        "parts/part.h": _file(
            (part,), "What the parts of the control law share.",
            f"{shared}{made.sources(part, inline=True)}", "BALLBOT_PART_H",
        ),
        "parts/steps.h": _file(
            PARTS, "The steps of the parts.",
            f'#include "parts/part.h"\n\n{steps}', "BALLBOT_STEPS_H",
        ),
        "estimation/heading.c": _file(
            (heading,), heading.__doc__ or "", f'#include "estimation/heading.h"\n\n{made.sources(heading)}'
        ),
        "estimation/heading.h": _file(
            (heading,), "Unwrapped headings.", f"{shared}{made.declarations(heading)}", "BALLBOT_HEADING_H"
        ),
        "estimation/swing.c": _file(
            (swing,), swing.__doc__ or "", f'#include "estimation/swing.h"\n\n{made.sources(swing)}'
        ),
        "estimation/swing.h": _file(
            (swing,), "Attitudes as lean and heading, and the robot's state.",
            f'#include "estimation/kalman_model.h"\n\n{made.declarations(swing)}', "BALLBOT_SWING_H",
        ),
        "estimation/slip.c": _file(
            (slip,), slip.__doc__ or "",
            f'#include "estimation/slip.h"\n\n#include "estimation/swing.h"\n\n{made.sources(slip)}',
        ),
        "estimation/slip.h": _file(
            (slip,), "Wheels that slip, and pushes.",
            f'#include "estimation/kalman_model.h"\n#include "estimation/onboard.h"\n\n{made.declarations(slip)}',
            "BALLBOT_SLIP_H",
        ),
        "estimation/known.h": _file(
            (known,), "What both estimators ask of a reading.",
            f"{shared}{made.sources(known, inline=True)}", "BALLBOT_KNOWN_H",
        ),
        "estimation/onboard.c": _file(
            (onboard,), onboard.__doc__ or "",
            f'#include "estimation/onboard.h"\n\n#include "estimation/known.h"\n\n{made.sources(onboard)}',
        ),
        "estimation/onboard.h": _file(
            (onboard,), "The on-board state, the thesis's way.",
            f"{shared}{made.declarations(onboard)}", "BALLBOT_ONBOARD_H",
        ),
        "decide.c": _file(
            (law,), law.__doc__ or "",
            f'#include "law.h"\n\n#include "estimation/heading.h"\n#include "parts/policy.h"\n'
            f'#include "parts/steps.h"\n\n{made.sources(law)}',
        ),
    }  # fmt: skip
    for one in PARTS:
        text = f'#include "parts/steps.h"\n\n{made.sources(one)}'
        files[f"parts/{_plain_name(one)}.c"] = _file((one,), one.__doc__ or "", text)
    return files
