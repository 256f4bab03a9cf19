"""Whether two logs are of the same run: by rows that both have.

Sensors with noise do not measure the same twice. So logs that have many rows in common, as far as `QUANTUM`, were
copied from each other, whole or in part, whatever their files and clocks. A few rows' hashes (`fingerprint`) show later
whether a log is one of those that a robot was identified from.
"""

import hashlib
from collections.abc import Collection, Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.columns import MAX_WHEELS, torque_names
from ballbot.log.log import Log

#: rows are compared to this, in SI units: below the noise of any sensor, above a rounding
QUANTUM = 2e-5
_LARGEST = 2.0**53  # beyond, no value is that fine
#: what a row is known by; position and heading begin anywhere
_COLUMNS = ("theta", "phi", "theta_dot", "phi_dot", "psi_dot", *torque_names(MAX_WHEELS))
#: logs are of one run if they have this share of the shorter one's rows in common
_SHARE = 0.05
#: of the columns, those that are not zero in a row that counts: others are of a robot at rest
_MOVING = 4
#: rows in a fingerprint, digits of each hash, and how many at least must be found in another log
_ROWS, _DIGITS, _FOUND = 8, 12, 2


def _row_hashes(log: Log) -> frozenset[str]:
    """Return hashes of the rows that appear once in a log, without those at rest."""
    table = np.column_stack([log[name] for name in _COLUMNS if name in log] or [np.zeros((len(log), 0))])
    finite = table[np.isfinite(table).all(axis=1)]
    rounded = np.clip(np.rint(finite / QUANTUM), -_LARGEST, _LARGEST).astype(np.int64)
    rows, counts = np.unique(rounded, axis=0, return_counts=True)
    moving: NDArray[np.int64] = rows[(counts == 1) & ((rows != 0).sum(axis=1) >= _MOVING)]
    return frozenset(hashlib.sha256(row.tobytes()).hexdigest()[:_DIGITS] for row in moving)


def fingerprint(log: Log) -> tuple[str, ...]:
    """Return the hashes of a few rows of a log, always the same."""
    return tuple(sorted(_row_hashes(log))[:_ROWS])


def logs_among(logs: Mapping[str, Log], fingerprints: Collection[str]) -> list[str]:
    """Return the names of the logs that have rows with these hashes."""
    if not fingerprints:
        return []
    known = set(fingerprints)
    return [name for name, log in logs.items() if len(_row_hashes(log) & known) >= _FOUND]


def refuse_copies(logs: Mapping[str, Log]) -> None:
    """Raise InputError if two logs have rows in common, of one run: the second one is no further measurement."""
    hashes = {name: _row_hashes(log) for name, log in logs.items()} if len(logs) > 1 else {}
    for (first, hashes_of_first), (second, hashes_of_second) in combinations(hashes.items(), 2):
        both = len(hashes_of_first & hashes_of_second)
        if both >= _FOUND and both > _SHARE * min(len(hashes_of_first), len(hashes_of_second)):
            raise InputError(
                f"{second} is of the same run as {first}: {both} of its rows are the same. Leave it out: the same "
                "measurement twice shows no more."
            )
