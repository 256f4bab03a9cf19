"""Files: read whole and within bounds, written whole or not at all.

Every loader reads through here. A pipe or a device is refused before it is opened, a file's size is known before it is
read, and depth and numbers that a parser cannot handle are found before or right after it is parsed (TOML, JSON). What
is written appears at its place at once: a reader sees the old content or the new, never a part.
"""

import codecs
import hashlib
import json
import os
import stat
import tempfile
import tomllib
from pathlib import Path

from ballbot.arrays import format_bytes
from ballbot.errors import InputError, either, nearest

#: bytes of the largest table; as text it takes about six times as much memory
LARGEST_TABLE = 500_000_000
#: bytes of the largest file of settings (TOML) and of results (JSON)
LARGEST_SETTINGS, LARGEST_RESULTS = 1_000_000, 10_000_000
#: tables and lists within one another
DEEPEST = 32
#: whole numbers of TOML are those of 64 bits
_LARGEST_WHOLE = 2**63
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def check_regular(path: str | Path) -> int:
    """Return the size of a regular file [bytes]; InputError if it is not there, or is a folder, a pipe or a device."""
    try:
        status = os.stat(path)
    except OSError as error:
        near = nearest_file(path)
        hint = f"; did you mean {near}?" if near else "."
        raise InputError(f"{path} cannot be read: {error.strerror or error}{hint}") from None
    except ValueError:
        raise InputError(f"{str(path)!r} contains a zero byte and cannot be a file name.") from None
    kind = _kind(status)
    if kind == "folder":
        found = [str(one) for pattern in _READ for one in sorted(Path(path).glob(pattern)) if one.is_file()]
        hint = f" Name a file in it, such as {either([*dict.fromkeys(found)][:2])}." if found else ""
        raise InputError(f"{path} cannot be read: Is a directory.{hint}")
    if kind != "file":
        raise InputError(f"{path} is a {kind}, which may have no end; copy its content into a file first.")
    return status.st_size


#: what commands read in a folder, the files of a record or a result first
_READ = ("log.*", "robot.toml", "controller.toml", "*.csv", "*.toml")


def _kind(status: os.stat_result) -> str:
    """Return what is at a path: a file, a folder, a pipe, a socket or a device."""
    kinds = {stat.S_IFREG: "file", stat.S_IFDIR: "folder", stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket"}
    return kinds.get(stat.S_IFMT(status.st_mode), "device")


def nearest_file(path: str | Path) -> str:
    """Return the file whose name is most like that of one that is not there; empty if none is."""
    path = Path(path)
    try:
        names = [one.name for one in path.parent.iterdir() if one.is_file()]
    except OSError:
        return ""
    near = nearest(path.name, names, likeness=0.75)
    return str(path.with_name(near[0])) if near and near[0] != path.name else ""


def read_bytes(path: str | Path, *, largest: int = LARGEST_TABLE) -> bytes:
    """Return the content of a regular file; InputError if it cannot be read or has more than `largest` bytes."""
    size = check_regular(path)
    if size <= largest:
        try:
            with open(path, "rb") as stream:
                content = stream.read(max(size, 1_000_000) + 1)  # a file of /proc does not say its size
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
        if len(content) <= largest:
            return content
    raise InputError(f"{path} has {format_bytes(size)}; at most {format_bytes(largest)} are read.")


def read_text(path: str | Path, *, largest: int = LARGEST_TABLE) -> str:
    """Return the text of a file in UTF-8, without the mark that some editors set before it.

    Line ends are those of the file made "\\n".

    InputError as `read_bytes`, and if it is no text in UTF-8.
    """
    return decode_text(read_bytes(path, largest=largest), source=str(path))


def decode_text(content: bytes, *, source: str) -> str:
    """Return bytes as text in UTF-8, as `read_text` does; a refusal names `source`."""
    if content.startswith(_UTF_16):
        raise InputError(f"{source} is not a text file in UTF-8 but in UTF-16; save it as UTF-8.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"{source} is not a text file in UTF-8; if it is text in another encoding, as Latin-1, save it as UTF-8."
        ) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_toml(path: str | Path) -> dict[str, object]:
    """Return the tables of a TOML file; InputError as `read_text`, and as `parse_toml`."""
    return parse_toml(read_text(path, largest=LARGEST_SETTINGS), source=str(path))


def parse_toml(text: str, *, source: str) -> dict[str, object]:
    """Return the tables of a text in TOML; a refusal names `source`.

    InputError if it is not TOML, is nested too deeply, or holds a whole number that does not fit 64 bits.
    """
    try:
        tree = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{source} is nested too deeply to be read.") from None
    except ValueError as error:  # TOMLDecodeError, or a whole number of thousands of digits
        raise InputError(f"{source} is not valid TOML: {_short(error)}.") from None
    _check_tree(tree, source)
    return tree


def read_json(path: str | Path) -> object:
    """Return what a JSON file holds; InputError as `read_text`, and if it is not JSON or is nested too deeply."""
    text = read_text(path, largest=LARGEST_RESULTS)
    try:
        tree = json.loads(text)
    except RecursionError:
        raise InputError(f"{path} is nested too deeply to be read.") from None
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON: {_short(error)}.") from None
    _check_tree(tree, str(path))
    return tree


def _check_tree(tree: object, source: str, place: str = "", depth: int = 0) -> None:
    """Refuse depth and whole numbers beyond what the rest reckons with."""
    if depth > DEEPEST:
        raise InputError(
            f"{source} is nested too deeply; at most {DEEPEST} levels of tables or lists are read."
        )
    if isinstance(tree, dict):
        for key, one in tree.items():
            _check_tree(one, source, f"{place}.{key}" if place else str(key), depth + 1)
    elif isinstance(tree, list):
        for one in tree:
            _check_tree(one, source, place, depth + 1)
    elif isinstance(tree, int) and abs(tree) >= _LARGEST_WHOLE:
        raise InputError(f"{source}: {_short(place)} is a whole number too large for 64 bits.")


def _short(words: object) -> str:
    text = str(words) if str(words).isprintable() else repr(str(words))
    return text if len(text) <= 200 else f"{text[:200]}..."


#: so much of a file's name is in the name of the part of it that is not yet whole; names have limits
_PARTIAL_NAME = 40


def check_file(
    path: str | Path,  # A link is followed, so that what it names is written and the link stays
) -> Path:
    """Return where a file is to be written, before work begins that would be lost without it.

    InputError if a folder, a device, a pipe or a loop of links is there, or the path cannot be looked up.
    """
    try:
        kind = _kind(os.stat(path))
    except FileNotFoundError:
        kind = "file"
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be written: {_reason(error)}.") from None
    if kind != "file":
        raise InputError(f"{path} is a {kind}; a file is needed. Choose another path.")
    return Path(os.path.realpath(path))


def check_new_file(
    path: str | Path,  # see `check_file`
    *,
    force: bool,  # whether to replace an existing file
) -> None:
    """Check where a file is to be written that its user then edits; such a file is replaced only if asked for.

    InputError if the path cannot be written, or the file exists and `force` is not given.
    """
    if check_file(path).exists() and not force:
        raise InputError(f"{path} already exists. Choose another name, or replace it with --force.")


def write_bytes(
    path: str | Path,  # where to, see `check_file`; missing folders are made
    data: bytes,  # the whole content
) -> None:
    """Write a file so that a reader sees the old content or the new, never a part.

    InputError if it cannot be written; the old content is then as it was.
    """
    target = check_file(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        descriptor, partial = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:_PARTIAL_NAME]}.")
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


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's content as hexadecimal digits; OSError if it cannot be read."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def check_folder(out: str | Path) -> Path:
    """Return the folder, made if there was none, before work begins that would be lost without it.

    InputError if something else is there, or it cannot be made or written into.
    """
    folder = Path(out)
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder} is a {_kind(folder.stat())}; --out needs a folder.")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"Nothing can be written into {folder}: {_reason(error)}.") from None


def _reason(error: OSError | ValueError) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)
