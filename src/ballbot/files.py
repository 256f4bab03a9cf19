"""Files written whole or not at all, and the folders for them."""

import os
import tempfile
from pathlib import Path

from ballbot.errors import InputError


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file so that a reader sees the old content or the new, never a part.

    Parameters
    ----------
    path : str or Path
        Where to; missing folders are made.
    data : bytes
        The whole content.

    Raises
    ------
    InputError
        Where the folder cannot be made or written to.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, partial = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from None
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(partial, 0o644)
        os.replace(partial, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from None
    finally:
        Path(partial).unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8) whole or not at all; see `write_bytes`."""
    write_bytes(path, text.encode("utf-8"))


def remove(path: str | Path) -> None:
    """Delete a file, if there is one, with the parts that a killed `write_bytes` may have left beside it."""
    path = Path(path)
    path.unlink(missing_ok=True)
    for partial in path.parent.glob(f".{path.name}.*"):
        partial.unlink(missing_ok=True)


def check_folder(out: str | Path) -> Path:
    """Return the folder, made where there was none, before work begins that would be lost without it.

    Raises
    ------
    InputError
        Where it is a file, cannot be made or cannot be written into.
    """
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; --out needs a folder.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be made: {error.strerror or error}.") from None
    try:
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise InputError(f"Nothing can be written into {folder}: {error.strerror or error}.") from None
