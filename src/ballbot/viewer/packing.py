"""Columns as few bytes of text: whole numbers of 16 bits where these resolve the column, else floats of 32 bits.

The text is base64 of little-endian numbers. Of a column of whole numbers k the value is offset + step k, and 65535
marks a missing value; the error is at most half a step.
"""

import base64

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats

_MISSING = 65535
#: a value may be off by this share of the column's unit (m, rad, N m, mm, degrees): below what a picture shows
RESOLUTION = 1e-4


def packed(values: Floats, *, resolution: float = RESOLUTION) -> dict[str, object]:
    """Return a column (K,) as the page reads it, each value within `resolution` or a float's own."""
    known = values[np.isfinite(values)]
    offset = float(known.min()) if known.size else 0.0
    step = (float(known.max()) - offset) / (_MISSING - 1) if known.size else 0.0
    if step > 2.0 * resolution:
        return {"kind": "float32", "data": _text(values.astype("<f4"))}
    scale = step or 1.0
    whole = np.where(np.isfinite(values), np.rint((values - offset) / scale), _MISSING).astype("<u2")
    return {"kind": "uint16", "offset": offset, "step": scale, "data": _text(whole)}


def _text(numbers: NDArray[np.generic]) -> str:
    return base64.b64encode(numbers.tobytes()).decode("ascii")
