"""Friction laws of one driveline: the classical one, which moves an inertia, and bristles for the twin's drivelines."""

from typing import get_args

from ballbot.mechanics.friction_laws.bristles import Dahl as Dahl
from ballbot.mechanics.friction_laws.bristles import LuGre as LuGre
from ballbot.mechanics.friction_laws.classical import Classical as Classical

#: the registry of the laws whose force is a function of a state of their own
BristleLaw = Dahl | LuGre
#: these by their names in files
BRISTLE_LAWS: dict[str, type[BristleLaw]] = {law.__name__.lower(): law for law in get_args(BristleLaw)}
