"""Checks of a log: its faults, their likely causes, and the uses that it permits.

run              all checks of one log or of a robot's logs; `checked_logs`, which an analysis calls first
time_and_rates   time, missing cells; positions and angles against their rates: units, signs, swapped columns
values           spikes, dead and saturated columns, unknown names, falls, jumps, offsets
repetition       values, rows or a whole log that froze or repeats
kinematics       wheel columns against the states
torques          torques by themselves: dead, unrelated to the motion, late
lean             lean axes against the ball's acceleration
torque_balance   torques against those that the motion needs: order, sign, scale
physics          the last three in their order, several logs against each other, disturbances
"""

from ballbot.log.checks.run import (
    CheckedLogs,
    bench_findings,
    check,
    check_logs,
    checked_logs,
    needed_columns,
)

__all__ = ["CheckedLogs", "bench_findings", "check", "check_logs", "checked_logs", "needed_columns"]
