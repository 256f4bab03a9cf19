"""Ready-made controllers: one file a kind, which begins with what it is for and ends with its `KIND`.

To add one, write such a file here: `ballbot design --kind`, `simulate --controller`, `compare` and Python take its
name. A study tries those of its `candidates`.
"""

from collections.abc import Mapping
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType

from ballbot.control.presets.kind import ControllerKind
from ballbot.control.presets.nominal import NOMINAL_STATE_WEIGHTS as NOMINAL_STATE_WEIGHTS
from ballbot.control.presets.nominal import NOMINAL_TORQUE_WEIGHT as NOMINAL_TORQUE_WEIGHT
from ballbot.control.presets.nominal import design_gain as design_gain
from ballbot.control.presets.nominal import nominal_controller as nominal_controller
from ballbot.control.presets.precise import PRECISE_INTEGRAL_WEIGHTS as PRECISE_INTEGRAL_WEIGHTS
from ballbot.control.presets.precise import PRECISE_STATE_WEIGHTS as PRECISE_STATE_WEIGHTS
from ballbot.control.presets.precise import design_integral_gain as design_integral_gain
from ballbot.control.presets.precise import precise_controller as precise_controller

_MODULES = sorted(one.name for one in iter_modules(__path__) if one.name != "kind")
#: every kind by its name
KINDS: Mapping[str, ControllerKind] = MappingProxyType(
    {kind.name: kind for kind in (import_module(f"{__name__}.{name}").KIND for name in _MODULES)}
)
