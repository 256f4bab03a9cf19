"""The result of a batch of robots in closed loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.summary import Summary, counted, range_words, summarized


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoopBatch:
    """The result of `simulate_batch`, a lane for each robot."""

    t: NDArray[np.float64]  #: (records,) [s]
    states: NDArray[np.float64]  #: (lanes, records, 10); a lane that ended or settled stays where it was
    torques: NDArray[np.float64]  #: (lanes, records, n) held over the sample that ends at t [N m]
    #: (lanes, records, 10) the state that the controller was given at the sample that ends at t
    seen: NDArray[np.float64]
    ended: NDArray[np.float64]  #: (lanes,) time [s] at which a lane ended; infinity where it did not
    #: (lanes,) time [s] at which a `Verdict` saw it settled; infinity if it never did
    settled: NDArray[np.float64]
    lifted: NDArray[np.bool_]  #: (lanes,) whether it ended because the floor would have had to pull
    slipped: NDArray[np.bool_]  #: (lanes,) whether it ended because a wheel would have slipped on the ball
    #: (lanes,) root mean square from sample to sample, of all wheels [N m]
    torque_change: NDArray[np.float64]

    @property
    def finals(self) -> NDArray[np.float64]:
        """The last states (lanes, 10)."""
        return self.states[:, -1]

    @property
    def survived(self) -> NDArray[np.bool_]:
        """Whether each lane (lanes,) ran to the end."""
        return np.isinf(self.ended)

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
        settled = np.isfinite(self.settled)
        if settled.any():
            rows.append(("settled", f"{_share(settled)}, {_times(self.settled[settled])}"))
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
        title = f"Batch of {counted(lanes, 'robot')} over {self.t[-1]:.4g} s"
        return Summary(title=title, rows=tuple(rows))


def _share(which: NDArray[np.bool_]) -> str:
    return f"{which.sum()} of {len(which)} ({100.0 * which.mean():.3g} %)"


def _times(times: NDArray[np.float64]) -> str:
    return f"at {times[0]:.3g} s" if len(times) == 1 else f"from {range_words(times, 's')}"
