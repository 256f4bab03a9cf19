"""Files written whole or not at all; only regular files and folders are written to."""

import hashlib
import os
import stat
import tempfile
from pathlib import Path

from ballbot.errors import InputError

#: so much of a file's name is in the name of the part of it that is not yet whole; names have limits
_PARTIAL_NAME = 40
_SEAL_LENGTH = len("\nsha256 ") + 64


def check_file(path: str | Path) -> Path:
    """Return where a file is to be written, before work begins that would be lost without it.

    Parameters
    ----------
    path : str or Path
        A link is followed, so that what it names is written and the link stays.

    Returns
    -------
    Path
        Of a regular file, or of none as yet.

    Raises
    ------
    InputError
        If a folder, a device, a pipe or a loop of links is there, or the path cannot be looked up.
    """
    path = Path(path)
    try:
        kind = _kind(path)
        target = Path(os.path.realpath(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be written: {_reason(error)}.") from None
    if kind not in ("", "file"):
        raise InputError(f"{path} is a {kind}; a file is needed. Choose another path.")
    return target


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file so that a reader sees the old content or the new, never a part.

    Parameters
    ----------
    path : str or Path
        Where to, see `check_file`; missing folders are made.
    data : bytes
        The whole content.

    Raises
    ------
    InputError
        If it cannot be written; the old content is then as it was.
    """
    target = check_file(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        descriptor, partial = tempfile.mkstemp(dir=target.parent, prefix=_partial_prefix(target))
    except OSError as error:
        raise InputError(f"{path} cannot be written: {_reason(error)}.") from None
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(partial, 0o644)
        os.replace(partial, target)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {_reason(error)}.") from None
    finally:
        Path(partial).unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    r"""Write a text file (UTF-8) whole or not at all; see `write_bytes`.

    What is not Unicode, as a file's name may hold, becomes \udcff: text that does not stop a report from being written.
    """
    write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


def write_sealed(path: str | Path, data: bytes, *, of: str = "") -> None:
    """Write a file of work that is gone on with, whole or not at all, with a checksum after it; see `read_sealed`.

    Parameters
    ----------
    path : str or Path
    data : bytes
    of : str
        What the data belongs to, as a digest of the code that made it; other data is not taken for it.
    """
    write_bytes(path, data + _seal(data, of))


def read_sealed(path: str | Path, *, of: str = "") -> bytes:
    """Return the data that `write_sealed` wrote.

    Raises
    ------
    InputError
        If it cannot be read, is damaged, was edited or belongs to something else.
    """
    try:
        found = check_file(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {_reason(error)}.") from None
    data = found[:-_SEAL_LENGTH]
    if found[-_SEAL_LENGTH:] != _seal(data, of):
        raise InputError(
            f"{path} is damaged, was edited or comes from another version of Ballbot; delete it to start "
            "again."
        )
    return data


def _seal(data: bytes, of: str) -> bytes:
    return b"\nsha256 " + hashlib.sha256(of.encode() + b"\n" + data).hexdigest().encode()


def remove(path: str | Path) -> None:
    """Delete a file, if there is one, with the parts that a killed `write_bytes` may have left beside it."""
    path = Path(path)
    path.unlink(missing_ok=True)
    prefix = _partial_prefix(path)
    for partial in path.parent.iterdir() if path.parent.is_dir() else ():
        if partial.name.startswith(prefix):
            partial.unlink(missing_ok=True)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's content as hexadecimal digits; OSError if it cannot be read."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def check_folder(out: str | Path) -> Path:
    """Return the folder, made if there was none, before work begins that would be lost without it.

    Raises
    ------
    InputError
        If something else is there, or it cannot be made or written into.
    """
    folder = Path(out)
    try:
        kind = _kind(folder)
        if kind not in ("", "folder"):
            raise InputError(f"{folder} is a {kind}; --out needs a folder.")
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"The folder {folder} cannot be made: {_reason(error)}.") from None
    try:
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise InputError(f"Nothing can be written into {folder}: {_reason(error)}.") from None


def _kind(path: Path) -> str:
    """Return what is at a path, links followed; nothing if there is nothing, OSError if it cannot be looked up."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return ""
    kinds = {stat.S_IFREG: "file", stat.S_IFDIR: "folder", stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket"}
    return kinds.get(stat.S_IFMT(mode), "device")


def _partial_prefix(path: Path) -> str:
    return f".{path.name[:_PARTIAL_NAME]}."


def _reason(error: OSError | ValueError) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)
