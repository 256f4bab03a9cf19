"""`ballbot convert`: a log in another file format."""

from __future__ import annotations

from pathlib import Path

from ballbot.cli.context import robot_beside
from ballbot.cli.output import notice_output, show_written
from ballbot.errors import InputError
from ballbot.files import check_new_file
from ballbot.log import Log
from ballbot.log.formats import write_columns, written_format
from ballbot.robot import Robot
from ballbot.viewer.foxglove import write_with_scene


def convert(
    log: Path,
    out: Path,
    /,
    *,
    mapping: Path | None = None,
    robot: str | None = None,
    decimal_comma: bool = False,
    force: bool = False,
) -> None:
    """Write a log in another file format, that of the suffix of OUT: .csv, .parquet, .npz, .mat, .mcap or .db3.

    An MCAP file opens in Foxglove and PlotJuggler and shows the robot in three dimensions. A .db3 file is a ROS 2 bag.

    Example: `ballbot convert run1/log.csv run1.mcap --robot alten`

    Example: `ballbot convert rosbag2_0.db3 run.csv --mapping mapping.toml`

    Parameters
    ----------
    log
        A log, or with --mapping any table.
    out
        The file to write.
    mapping
        A TOML file that describes the columns and units of a foreign log, as `ballbot check-log` writes it.
    robot
        A preset's name or a robot file: the robot in the scene of an MCAP file. If not given, it is the file robot.toml
        in the log's folder.
    decimal_comma
        Write CSV with decimal commas, and semicolons between the cells.
    force
        Replace an existing file.
    """
    written = written_format(out)
    if robot and written.name != "MCAP":
        raise InputError(f"--robot is for the scene of an MCAP file (.mcap); {out} has none.")
    described = Robot.load(robot) if robot else robot_beside(log)
    check_new_file(out, force=force)
    read = Log.read(log, mapping=mapping)
    if decimal_comma:
        write_columns(out, read.columns, decimal_comma=True)
    else:
        missing = write_with_scene(out, read, described)
        if missing:
            notice_output().print(missing, markup=False, soft_wrap=True)
    show_written(out, results={"rows": len(read), "columns": read.names})
