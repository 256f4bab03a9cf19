"""The controller that stays beside a study's new one, to go back to."""

from __future__ import annotations

from pathlib import Path

from ballbot.control.controller import Controller
from ballbot.control.file import controller_text
from ballbot.errors import InputError
from ballbot.inputs import LARGEST_SETTINGS, read_text

_BASELINE = """\
# The controller without friction compensation: to go back to if the new one does not do what was predicted. This
# folder held no other controller before.
"""


def previous_controller_text(folder: Path, *, new: Controller | None, baseline: Controller) -> str:
    """Return the text of the previous_controller.toml that a study writes.

    It is the controller.toml that the folder holds from an earlier study. If that is the new one itself, as after the
    same study again, or there is none, as after a study that recommends none, the folder's previous_controller.toml
    stays; without either it is the baseline.

    Parameters
    ----------
    folder : Path
        Of the study, with the files of the earlier one.
    new : Controller, optional
        None if the study recommends none.
    baseline : Controller
        Without compensation.
    """
    held = _text(folder / "controller.toml")
    if held is not None and (new is None or held != controller_text(new)):
        return held
    before = _text(folder / "previous_controller.toml")
    return _BASELINE + controller_text(baseline) if before is None else before


def _text(path: Path) -> str | None:
    try:
        return read_text(path, largest=LARGEST_SETTINGS)
    except InputError:  # not there, or no file of ours
        return None
