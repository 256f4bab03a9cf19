"""Friction laws behind one interface; the classical one is the default, and the robot's engine has only that.

`Classical`, `Armstrong`, `LuGre`, `Dahl` and, for comparison, `Smoothed` are values. `friction_at`,
`advance` and `follow` evaluate them; `ballbot.simulation.driveline` moves an inertia under them.
"""

from ballbot.mechanics.friction_laws.armstrong import Armstrong
from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.mechanics.friction_laws.dahl import Dahl
from ballbot.mechanics.friction_laws.interface import FrictionLaw, advance, follow, friction_at
from ballbot.mechanics.friction_laws.lugre import LuGre
from ballbot.mechanics.friction_laws.smoothed import Smoothed

__all__ = [
    "Armstrong",
    "Classical",
    "Dahl",
    "FrictionLaw",
    "LuGre",
    "Smoothed",
    "advance",
    "follow",
    "friction_at",
]
