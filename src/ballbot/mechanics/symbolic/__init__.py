"""The symbolic Lagrangian that reads like the thesis's Appendix II, for deriving and testing.

Needs SymPy: `pip install ballbot[symbolic]`.
"""

from ballbot.mechanics.symbolic.corrections import Corrections, corrections_of
from ballbot.mechanics.symbolic.derivation import Derivation, derive
from ballbot.mechanics.symbolic.oracle import Equations, equations

__all__ = ["Corrections", "Derivation", "Equations", "corrections_of", "derive", "equations"]
