"""The result of a batch of robots in closed loop."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import STATE_NAMES, TRUE_PREFIX, torque_names, wheel_angle_names, wheel_speed_names
from ballbot.simulation.model_plant import LIFTED, fallen_words
from ballbot.summary import Summarized, Summary, counted, range_words

#: the reference's columns in a log, and their places in the state
REFERENCES = (0, 1, 4)


def column_names(wheel_count: int, *, accelerometer: bool = False) -> list[str]:
    """Return the columns of a run's log, in their order."""
    return [
        "t",
        *torque_names(wheel_count),
        *STATE_NAMES,
        *wheel_angle_names(wheel_count),
        *wheel_speed_names(wheel_count),
        *(f"gyro_{axis}" for axis in "xyz"),
        *(f"acc_{axis}" for axis in "xyz" if accelerometer),
        *(f"ref_{STATE_NAMES[index]}" for index in REFERENCES),
        *(TRUE_PREFIX + name for name in STATE_NAMES),
    ]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ClosedLoopBatch(Summarized):
    """The result of `simulate_batch`, a lane for each robot."""

    t: NDArray[np.float64]  #: (records,) the first is 0, as in a log of `simulate` [s]
    #: (lanes, records, 10) the true states at t; a lane that ended stays where it was
    states: NDArray[np.float64]
    finals: NDArray[np.float64]  #: (lanes, 10) the states at the end of the run, a sample after the last row
    torques: NDArray[np.float64]  #: (lanes, records, n) at the end of the sample that begins at t [N m]
    seen: NDArray[np.float64]  #: (lanes, records, 10) the state that the controller was given at t
    commanded: NDArray[np.float64]  #: (lanes, records, n) what it asked for then [N m]
    wheel_angles: NDArray[np.float64]  #: (lanes, records, n) as they were measured then [rad]
    wheel_speeds: NDArray[np.float64]  #: (lanes, records, n) [rad/s]
    gyro: NDArray[np.float64]  #: (lanes, records, 3) body frame [rad/s]
    references: NDArray[np.float64]  #: (samples, 10)
    sample_time: float  #: [s]
    fallen_leans: NDArray[np.float64]  #: (1 or lanes,) at which a lane counts as fallen [rad]
    ended: NDArray[np.float64]  #: (lanes,) time [s] at which a lane ended; infinity if it did not
    lifted: NDArray[np.bool_]  #: (lanes,) whether it ended because the ball would have lifted off
    slipped: NDArray[np.bool_]  #: (lanes,) whether it ended because a wheel would have slipped on the ball
    #: (lanes,) root mean square from sample to sample, of all wheels [N m]
    torque_change: NDArray[np.float64]

    @property
    def next_states(self) -> NDArray[np.float64]:
        """The states (lanes, records, 10) one row later: after the last row those at the end of the run."""
        return np.concatenate([self.states[:, 1:], self.finals[:, None]], axis=1)

    @property
    def survived(self) -> NDArray[np.bool_]:
        """Whether each lane (lanes,) ran to the end."""
        return np.isinf(self.ended)

    def log(self, lane: int) -> Log:
        """Return a lane's run as `simulate` gives it, but for columns of an accelerometer.

        InputError if not every sample was recorded, or there is no such lane.
        """
        lanes, records, n = self.torques.shape
        if records != len(self.references):
            raise InputError(
                f"The batch recorded {counted(records, 'sample')} of {len(self.references)}; a log needs every sample "
                "(every=1)."
            )
        if not 0 <= lane < lanes:
            raise InputError(f"The lane is {lane}; it must be 0 to {lanes - 1}.")
        end = self.ended[lane]
        rows = records if np.isinf(end) else round(end / self.sample_time)
        parts = (
            np.round(np.arange(rows) * self.sample_time, 9)[:, None],
            self.commanded[lane, :rows],
            self.seen[lane, :rows],
            self.wheel_angles[lane, :rows],
            self.wheel_speeds[lane, :rows],
            self.gyro[lane, :rows],
            self.references[:rows, REFERENCES],
            self.states[lane, :rows],
        )
        table = np.vstack([part.T for part in parts])
        table.flags.writeable = False
        return Log.of_checked(dict(zip(column_names(n), table, strict=True)), self._why_ended(lane))

    def _why_ended(self, lane: int) -> str | None:
        if np.isinf(self.ended[lane]):
            return None
        limit = self.fallen_leans[lane if len(self.fallen_leans) > 1 else 0]
        if self.slipped[lane]:
            why = "slipped: a wheel needs more grip than it has"
        elif self.lifted[lane]:
            why = LIFTED
        else:
            why = fallen_words(limit)
        return f"{why} at t = {self.ended[lane]:.3f} s"

    def summary(self) -> Summary:
        """Return how the lanes ended, where they are at the end, and how hard the wheels worked."""
        lanes, records, wheels = self.torques.shape
        ended = ~self.survived
        fell = ended & ~self.lifted & ~self.slipped
        final = self.finals
        rows = [("ran to the end", _share(self.survived))]
        for name, which in (("fell", fell), ("lifted off", self.lifted), ("slipped", self.slipped)):
            if which.any():
                rows.append((name, f"{_share(which)}, {_times(self.ended[which])}"))
        rows += [
            ("last distance", f"{range_words(np.hypot(final[:, 0], final[:, 1]), 'm')} from the origin"),
            ("last lean", range_words(np.hypot(final[:, 2], final[:, 3]), "rad")),
            ("torques", range_words(self.torques, "N m")),
            ("torque change", f"{range_words(self.torque_change, 'N m')} from sample to sample (RMS)"),
            (
                "records",
                f"{counted(records, 'time')}, states {self.states.shape}, {counted(wheels, 'wheel')}",
            ),
        ]
        title = f"Batch of {counted(lanes, 'robot')} over {len(self.references) * self.sample_time:.4g} s"
        return Summary(title=title, rows=tuple(rows))


def _share(which: NDArray[np.bool_]) -> str:
    return f"{which.sum()} of {len(which)} ({100.0 * which.mean():.3g} %)"


def _times(times: NDArray[np.float64]) -> str:
    return f"at {times[0]:.3g} s" if len(times) == 1 else f"from {range_words(times, 's')}"
