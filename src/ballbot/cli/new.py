"""`ballbot new`: a robot file to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.output import emit, standard_output
from ballbot.errors import InputError
from ballbot.files import check_new_file
from ballbot.printable import printable_line, shell_line
from ballbot.robot import Robot
from ballbot.robot.file import write_robot


def new(
    name: str,
    /,
    *,
    from_: Annotated[str, Parameter(name="--from")] = "alten",
    out: Path | None = None,
    force: bool = False,
) -> None:
    """Write a robot file to start from: a commented copy of a preset under a new name.

    Example: `ballbot new myrobot --from alten`

    Parameters
    ----------
    name : str
        The new robot's name.
    from_ : str
        Preset or robot file to copy.
    out : Path
        File to write; NAME.toml if not given.
    force : bool
        Replace an existing file.
    """
    path = out or Path(f"{name}.toml")
    if printable_line(name) != name:
        raise InputError(f"{name!r} cannot be a robot's name; remove the characters that cannot be printed.")
    robot = Robot.load(from_).replace(name=name)
    if out is None and Path(name).name != name:
        raise InputError(f"{name!r} cannot be both a robot's name and a file name; give the file with --out.")
    check_new_file(path, force=force)
    write_robot(robot, path)
    hint = f"Wrote {path}. Change its values, then run: {shell_line(['ballbot', 'check', path])}"
    standard_output().print(hint, soft_wrap=True)
    emit({"files": [path]})
