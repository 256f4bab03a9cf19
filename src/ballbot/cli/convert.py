"""`ballbot convert`: a log in another file format."""

from pathlib import Path

from ballbot.cli import options
from ballbot.cli.output import show_written
from ballbot.files import check_new_file
from ballbot.log import Log
from ballbot.log.formats import written_format


def convert(
    log: Path,
    out: Path,
    /,
    *,
    mapping: options.Mapping = None,
    robot: options.MotorsOf = None,
    force: options.Force = False,
) -> None:
    """Write a log in another file format, that of the suffix of OUT: .csv, .parquet, .mat or .mcap.

    An MCAP file opens in Foxglove and PlotJuggler.

    Example: `ballbot convert run1/log.csv run1.mcap`

    Example: `ballbot convert rosbag2_0.db3 run.csv --mapping mapping.toml`

    Parameters
    ----------
    log
        A log, or with --mapping any table.
    out
        The file to write.
    """
    written_format(out)  # raises InputError before the log is read
    check_new_file(out, force=force)
    read = Log.read(log, mapping=mapping, robot=robot)
    read.write(out)
    show_written(
        out,
        f"The log has {len(read)} rows and {len(read.names)} columns.",
        results={"rows": len(read), "columns": read.names},
        next_step=f"`ballbot check-log {out}`",
    )
