"""Python files of users: run once in each process, and their errors in one sentence."""

import importlib.util
import sys
import traceback
from pathlib import Path
from types import ModuleType

from ballbot.errors import InputError

#: begins the names of users' files as modules
_OWN = "ballbot_own_"


def user_module(path: str | Path) -> ModuleType:
    """Return a Python file as a module; it is run once in each process, until it changes.

    Modules beside it can be imported, after Python's own and installed ones. InputError if it cannot be run.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(f"there is no Python file {str(path)!r}.")
    name = f"{_OWN}{file.stat().st_mtime_ns}_{file.resolve()}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, file)
        assert spec is not None  # its name ends in .py
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # dataclasses look their module up
        folder = str(file.resolve().parent)
        if folder not in sys.path:
            sys.path.append(folder)
        try:
            spec.loader.exec_module(module)
        except (Exception, SystemExit) as error:  # sys.exit ends nothing but this call
            del sys.modules[name]
            raise InputError(f"{path} cannot be run: {error_text(error, file)}.") from error
    return sys.modules[name]


def error_text(error: BaseException, file: Path) -> str:
    """Return an error in words, with the last line of the user's file that it passed through."""
    passed = traceback.extract_tb(error.__traceback__)
    lines = [one.lineno for one in passed if Path(one.filename).resolve() == file.resolve()]
    words = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".:")
    return f"{words} (line {lines[-1]})" if lines else words
