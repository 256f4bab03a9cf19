"""The numbers of a packed column, as the page computes them."""

import base64

import numpy as np

from ballbot.arrays import Floats
from ballbot.viewer.packing import _MISSING


def unpacked(column: dict[str, object]) -> Floats:
    """Return the values (K,) of a packed column, as the page computes them; NaN where missing."""
    data = base64.b64decode(str(column["data"]))
    if column["kind"] == "float32":
        return np.frombuffer(data, dtype="<f4").astype(np.float64)
    whole = np.frombuffer(data, dtype="<u2")
    offset, step = (float(str(column[name])) for name in ("offset", "step"))
    return np.where(whole == _MISSING, np.nan, offset + step * whole)
