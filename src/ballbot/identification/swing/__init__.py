"""A hanging body's inertia from one free swing: Appendix III of the thesis, with how sure it is.

A recorded swing (`record`) is fitted by a pendulum with viscous and dry friction at any amplitude (`pendulum`, `fit`),
and its frequency becomes the inertia (`inertia`).
"""

from ballbot.identification.swing.checks import recording_findings, swing_findings
from ballbot.identification.swing.fit import SwingFit, fit_swing
from ballbot.identification.swing.inertia import Estimate, Pivot, SwingInertia, inertia_of_swing
from ballbot.identification.swing.record import Swing, swing_in_log, swing_of
from ballbot.identification.swing.words import swing_remarks, swing_results, swing_rows

__all__ = [
    "Estimate",
    "Pivot",
    "Swing",
    "SwingFit",
    "SwingInertia",
    "fit_swing",
    "inertia_of_swing",
    "recording_findings",
    "swing_findings",
    "swing_in_log",
    "swing_of",
    "swing_remarks",
    "swing_results",
    "swing_rows",
]
