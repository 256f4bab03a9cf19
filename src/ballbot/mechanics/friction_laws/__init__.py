"""Friction laws behind one interface; the classical one is the default, and the robot's engine has only that.

`Classical`, `Armstrong`, `LuGre`, `Dahl` and, for comparison, `Smoothed` are values. `friction_at`,
`advance` and `follow` evaluate them; `ballbot.simulation.driveline` moves an inertia under them.
"""

from ballbot.mechanics.friction_laws.armstrong import Armstrong as Armstrong
from ballbot.mechanics.friction_laws.classical import Classical as Classical
from ballbot.mechanics.friction_laws.dahl import Dahl as Dahl
from ballbot.mechanics.friction_laws.interface import FrictionLaw as FrictionLaw
from ballbot.mechanics.friction_laws.interface import advance as advance
from ballbot.mechanics.friction_laws.interface import follow as follow
from ballbot.mechanics.friction_laws.interface import friction_at as friction_at
from ballbot.mechanics.friction_laws.lugre import LuGre as LuGre
from ballbot.mechanics.friction_laws.smoothed import Smoothed as Smoothed
