"""Results as JSON text, which knows no arrays and no NaN."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.log import STATE_NAMES
from ballbot.printable import json_escaped


def as_json(results: Mapping[str, object]) -> str:
    """Return results as JSON text: arrays as lists, what is not finite as null."""
    return json_escaped(json.dumps(_plain(results), indent=2, ensure_ascii=False, allow_nan=False)) + "\n"


def by_state(values: NDArray[np.float64]) -> dict[str, float]:
    """Return ten values by the states' names."""
    return dict(zip(STATE_NAMES, values.tolist(), strict=True))


def _plain(value: object) -> object:
    """Return what JSON can hold: plain containers, NaN and infinities as None."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(one) for one in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
