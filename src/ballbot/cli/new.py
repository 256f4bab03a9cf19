"""`ballbot new`: a robot file to start from."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli import options
from ballbot.cli.output import emit, standard_output
from ballbot.errors import InputError
from ballbot.files import check_new_file
from ballbot.printable import printable_line, shell_line
from ballbot.robot import Robot
from ballbot.robot.robot import is_model_file


def new(
    name: str,
    /,
    *,
    from_: Annotated[str, Parameter(name="--from")] = "alten",
    like: str = "alten",
    out: Path | None = None,
    force: options.Force = False,
) -> None:
    """Write a robot file to start from: a commented copy of a preset, or of a model in MJCF or URDF, under a new name.

    Example: `ballbot new myrobot --from alten`

    Example: `ballbot new myrobot --from myrobot.urdf --like alten`

    Parameters
    ----------
    name : str
        The new robot's name, or the file to write, which gives its name.
    from_ : str
        Preset or robot file to copy; or a model: .xml or .mjcf (MJCF), .urdf.
    like : str
        Preset or robot file for what a model does not state, such as gears and sensors; marked as assumed.
    out : Path
        File to write; NAME.toml if not given.
    """
    if out is None and Path(name).suffix.lower() == ".toml":
        out, name = Path(name), Path(name).stem
    if is_model_file(out or name):
        raise InputError(
            f"{out or name} would be a model; write one with: ballbot twin export ROBOT --out {out or name}"
        )
    path = out or Path(f"{name}.toml")
    if printable_line(name) != name:
        raise InputError(f"{name!r} cannot be a robot's name; remove the characters that cannot be printed.")
    if out is None and Path(name).name != name:
        raise InputError(f"{name!r} cannot be both a robot's name and a file name; give the file with --out.")
    console = standard_output()
    check_new_file(path, force=force)
    if is_model_file(from_):
        from ballbot.twin.model_files import read_model  # with compiled code

        model = read_model(from_, like=Robot.load(like))
        robot = model.robot.replace(name=name)
        read = f"Read from {from_}: {', '.join(model.stated)}."
        assumed = f"Assumed, mostly as in {like}: {', '.join(model.assumed)}. Check these."
        console.print("\n".join([read, assumed, *model.notes]), soft_wrap=True, markup=False)
    else:
        robot = Robot.load(from_).replace(name=name)
    robot.write(path)
    hint = f"Wrote {path}. Change its values.\nNext: `{shell_line(['ballbot', 'check', path])}`"
    console.print(hint, soft_wrap=True, markup=False)
    emit({"files": [path]})
