"""States at moments of a mapped log, from nothing that the file held only later.

A mapped log looks ahead, though a little: rates are differences that take in the next row, rows at even intervals lie
between two of the file's, and the repair of times looks `sampling_times.REACH` to each side. A prediction that starts
from such a row has seen some of what it predicts. So `causal_states` maps the file's rows anew for each moment, as if
the file ended there, and includes the row in which a sensor that reports late describes that moment; a rate that the
mapping differentiates is the slope of a line through the last rows.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.log.apply_mapping import apply_mapping, row_times, sensor_delay
from ballbot.log.columns import STATE_NAMES
from ballbot.log.formats import read_columns
from ballbot.log.log import Log
from ballbot.log.mapping import LogMapping
from ballbot.log.mapping_file import read_mapping
from ballbot.log.pose import with_position
from ballbot.robot import Robot

#: how much of the past is mapped [s], and the least that gives a state
_PAST, _LEAST_PAST = 1.0, 0.2
#: length of the line whose slope is a rate [s]
_LINE = 0.04
#: [s] by which rounding may move a row
_ROW_ROUNDING = 1e-6


def causal_states(
    path: str | Path, *, mapping: str | Path | LogMapping, robot: Robot, moments: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the states (m, 10) at rows of a mapped log, from what the file held by then.

    Parameters
    ----------
    path : str or Path
        The foreign file.
    mapping : str, Path or LogMapping
        How it becomes a log.
    robot : Robot
        Its wheels give the ball's path if the log has no position; it counts from the start of what is mapped, so
        that positions on the floor mean nothing and their rates do.
    moments : ndarray (m,)
        Times of rows of the log that file and mapping make [s].

    Returns
    -------
    ndarray (m, 10)
        NaN if too little of the file comes before.

    Raises
    ------
    InputError
        If the file or the mapping cannot be read or does not make a log.
    """
    mapping = mapping if isinstance(mapping, LogMapping) else read_mapping(mapping)
    table = read_columns(path, mapping.layout)
    t, late = row_times(mapping, table), sensor_delay(mapping)
    everything = replace(mapping, timing=replace(mapping.timing, keep=None))
    states = np.full((len(moments), len(STATE_NAMES)), np.nan)
    for number, moment in enumerate(moments):
        first = int(np.searchsorted(t, moment - _PAST))
        # the rows up to the first that describes the moment
        end = int(np.searchsorted(t, moment + late - _ROW_ROUNDING)) + 1
        if moment - t[first] >= _LEAST_PAST:
            rows = {name: values[first:end] for name, values in table.items()}
            past = Log(apply_mapping(everything, rows, even_from=float(t[0])))
            states[number] = _last_state(past.between(-np.inf, moment + _ROW_ROUNDING), mapping, robot)
    return states


def _last_state(past: Log, mapping: LogMapping, robot: Robot) -> NDArray[np.float64]:
    """Return the state (10,) in the last row."""
    by_wheels = "x" not in past
    past = with_position(past, robot)
    state = past.states[-1]
    differentiated = set(mapping.derivatives)
    if by_wheels and "wheel1_dot" in differentiated:
        differentiated |= {"x_dot", "y_dot"}
    rows = min(len(past), max(3, 1 + round(_LINE / past.sample_time)))
    times = past.t[-rows:] - past.t[-1]
    half = len(STATE_NAMES) // 2
    for place, name in enumerate(STATE_NAMES[:half]):
        if f"{name}_dot" in differentiated:
            slope, value = np.polyfit(times, past[name][-rows:], 1)
            state[place], state[half + place] = value, slope
    return state
