"""Stage two of the thesis: friction of drivelines and ball-wheel contacts from the robot upside down."""

from ballbot.identification.upside_down.identify import identify_upside_down
from ballbot.identification.upside_down.result import UpsideDown

__all__ = ["UpsideDown", "identify_upside_down"]
