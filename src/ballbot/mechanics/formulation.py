"""The two formulations of the equations of motion (design section 5)."""

from typing import Literal

#: "exact": the corrected rigid-body model; "thesis": Appendix II as printed, only its misprints mended
Formulation = Literal["exact", "thesis"]
