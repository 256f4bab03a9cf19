"""Register the page of a class of results, behind `summary()`, `repr` and `to_dict()`, and the figure of `plot()`."""

from functools import partial

from matplotlib.figure import Figure

from ballbot.control.controller import Controller
from ballbot.control.margins import Margins, loop_margins
from ballbot.errors import InputError
from ballbot.identification import Identification
from ballbot.identification.axis import AxisIdentification
from ballbot.identification.upside_down import UpsideDown
from ballbot.learning.learn import Learned
from ballbot.log import Log
from ballbot.mechanics.friction import steady_friction
from ballbot.registry import FIGURES, PAGES
from ballbot.report.axis import axis_report, laws_figure
from ballbot.report.bench import curve_figure, upside_down_report
from ballbot.report.comparison import course_tracks, league_report, paths_figure, shown_runs
from ballbot.report.design import bode_figure, controller_design_report
from ballbot.report.identification import friction_figure, identification_report
from ballbot.report.learning import curve_series, learning_report
from ballbot.report.limits import planes_figure
from ballbot.report.plan import plan_report, plan_series
from ballbot.report.run import over_time
from ballbot.report.series import TimeSeries
from ballbot.report.study import study_report
from ballbot.report.style import plotted, series_figure
from ballbot.report.validation import horizon_figure, validation_report
from ballbot.robot import Robot
from ballbot.robot.figure import robot_figure
from ballbot.validation.result import Validation
from ballbot.workflows.controller_design import ControllerDesign
from ballbot.workflows.league import League
from ballbot.workflows.limits import RobotLimits
from ballbot.workflows.plan import Plan
from ballbot.workflows.study import Study

#: wheel speeds shown reach this many Stribeck speeds
_SHOWN_SPEEDS = 8.0


def log_figure(log: Log) -> Figure:
    """Return position, lean, heading, torques and wheel speeds over time, as far as the log has them."""
    series = next((block for block in over_time(log, None) if isinstance(block, TimeSeries)), None)
    if series is None:
        raise InputError("The log has no position, lean, heading, torques or wheel speeds to plot.")
    return series_figure(series)


def controller_figure(controller: Controller) -> Figure:
    """Return the Bode diagram of the loop; InputError if it is unstable."""
    return bode_figure(loop_margins(controller))


def upside_down_figure(fit: UpsideDown) -> Figure:
    """Return each wheel's friction over its speed."""
    friction = fit.robot.friction
    curves = [partial(steady_friction, friction=friction.of_wheel(i)) for i in range(fit.robot.wheel_count)]
    return curve_figure(curves, _SHOWN_SPEEDS * friction.stribeck_speed)


PAGES.update(
    {
        AxisIdentification: axis_report,
        ControllerDesign: controller_design_report,
        Identification: identification_report,
        Learned: learning_report,
        League: league_report,
        Plan: plan_report,
        Study: study_report,
        UpsideDown: upside_down_report,
        Validation: validation_report,
    }
)
for kind, draw in {
    AxisIdentification: laws_figure,
    Controller: controller_figure,
    ControllerDesign: lambda design: bode_figure(design.loop_margins),
    Identification: friction_figure,
    Learned: lambda learned: series_figure(curve_series(learned)),
    League: lambda league: paths_figure(course_tracks(league, league.courses[0])),
    Log: log_figure,
    Plan: lambda plan: series_figure(plan_series(plan)),
    Margins: bode_figure,
    Robot: robot_figure,
    RobotLimits: lambda limits: planes_figure({"limits": limits}),
    Study: lambda study: paths_figure(shown_runs(study.choice)),
    UpsideDown: upside_down_figure,
    Validation: lambda validation: horizon_figure(validation.horizon, validation.models.names),
}.items():
    FIGURES[kind] = partial(plotted, draw)
