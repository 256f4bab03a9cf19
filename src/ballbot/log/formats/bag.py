"""ROS 2 bags as folders, as `ros2 bag record` writes them: metadata.yaml names the files of the recording in order.

A long recording is split into several files (.db3 or .mcap), which are read as one. Files that are compressed as a
whole (.zstd) are unpacked, as far as `ballbot.files` allows; the limit is of all files together.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Mapping
from pathlib import Path, PurePath

from ballbot.arrays import format_bytes
from ballbot.errors import InputError
from ballbot.files import DEEPEST, LARGEST_SETTINGS, LARGEST_TABLE, read_bytes, read_text
from ballbot.log.columns import Columns
from ballbot.log.formats.mcap import mcap_messages, read_mcap
from ballbot.log.formats.messages import Topic
from ballbot.log.formats.ros import RosMessage, read_ros_bag, ros_columns, stored_messages

METADATA = "metadata.yaml"
_INFORMATION = "rosbag2_bagfile_information"
_STORED, _MCAP, _PACKED = ".db3", ".mcap", ".zstd"


def read_bag_folder(folder: str | Path) -> Columns:
    """Return the columns of the files of a bag, which are read as one.

    Raises
    ------
    InputError
        If the folder has no metadata.yaml or a file that this names is missing, damaged, too large or of another kind.
    """
    paths = bag_files(folder)[1:]
    if len(paths) == 1 and paths[0].suffix != _PACKED:  # a log that Ballbot wrote is read back to the bit
        return read_ros_bag(paths[0]) if paths[0].suffix == _STORED else read_mcap(paths[0])
    messages: list[RosMessage] = []
    topics: dict[str, Topic] = {}
    left = LARGEST_TABLE
    for path in paths:
        content = _content(path, left)
        before = len(messages)
        try:
            if path.name.removesuffix(_PACKED).endswith(_STORED):
                messages += stored_messages(content)
                size = sum(len(one.data) for one in messages[before:])
            else:
                found = mcap_messages(content)
                size = found.size
                messages += found.ros
                for name, more in found.topics.items():
                    here = topics.setdefault(name, Topic(name=name))
                    here.times += more.times
                    here.messages += more.messages
        except _DAMAGED as error:
            reason = f": {error}" if isinstance(error, InputError) else ""
            raise InputError(
                f"{path} cannot be read: it is not a complete file of a ROS 2 bag{reason}."
            ) from None
        left -= max(len(content), size)
        if left < 0:
            raise _too_large(Path(folder))
    try:
        return ros_columns(messages, [one for one in topics.values() if one.messages])
    except _DAMAGED as error:
        reason = f": {error}" if isinstance(error, InputError) else ""
        raise InputError(f"{folder} cannot be read: its messages are damaged{reason}.") from None


#: what the libraries raise on files that are damaged
_DAMAGED = (sqlite3.Error, struct.error, ArithmeticError, AssertionError, AttributeError, LookupError, MemoryError,
            RecursionError, RuntimeError, TypeError, ValueError)  # fmt: skip


def is_bag_folder(path: str | Path) -> bool:
    """Return whether a path is a folder with the metadata of a ROS 2 bag."""
    return (Path(path) / METADATA).is_file()


def bag_files(folder: str | Path) -> list[Path]:
    """Return metadata.yaml and the files of a bag in its order; each is in the folder itself.

    Raises
    ------
    InputError
        If metadata.yaml is missing, damaged, or does not name files of the folder that are read.
    """
    folder = Path(folder)
    metadata = folder / METADATA
    if not metadata.exists():
        try:
            parts = sorted(one.name for one in folder.iterdir() if one.suffix in (_STORED, _MCAP))
        except OSError as error:
            raise InputError(f"{folder} cannot be read: {error.strerror or error}.") from None
        if not parts:
            raise InputError(f"{folder} cannot be read: Is a directory.")
        raise InputError(
            f"{folder} is a folder without {METADATA}, which names the files of a ROS 2 bag; write it with: ros2 bag "
            f"reindex {folder}. Or give a file in the folder: {folder / parts[0]}."
        )
    information = _information(metadata)
    names = information.get("relative_file_paths")
    if not (isinstance(names, list) and names and all(isinstance(one, str) for one in names)):
        raise InputError(f"{metadata} names no files in relative_file_paths.")
    if str(information.get("compression_mode", "")).lower() == "message":
        raise InputError(
            f"{folder} has messages that are compressed one by one, which is not read; unpack it with ros2 bag convert."
        )
    # bags of before version 4 have the folder's own name before the file's
    paths = [folder / PurePath(one).name for one in names]
    if len(set(paths)) < len(paths):
        raise InputError(f"{metadata} names a file twice in relative_file_paths.")
    for path in paths:
        if PurePath(path.name.removesuffix(_PACKED)).suffix not in (_STORED, _MCAP):
            raise InputError(f"{metadata} names {path.name}; files of a bag end in {_STORED} or {_MCAP}.")
        if not path.exists():
            raise InputError(f"{path} is missing; {metadata} names it as a part of the bag.")
    return [metadata, *paths]


def _information(metadata: Path) -> Mapping[str, object]:
    """Return what metadata.yaml says of the bag: text, lists and tables."""
    from ruamel.yaml.error import YAMLError

    text = read_text(metadata, largest=LARGEST_SETTINGS)
    try:
        tree = _yaml_tree(text)
    except (YAMLError, ValueError, TypeError, AttributeError) as error:
        reason = f": {error}" if isinstance(error, InputError) else ""
        raise InputError(
            f"{metadata} is not valid YAML of a bag{reason}; write it anew with ros2 bag reindex."
        ) from None
    information = tree.get(_INFORMATION) if isinstance(tree, dict) else None
    if not isinstance(information, dict):
        raise InputError(f"{metadata} is not of a ROS 2 bag: it has no {_INFORMATION}.")
    return information


def _yaml_tree(text: str) -> object:
    """Return a text in YAML as lists and tables of text: no tags, no aliases, which multiply."""
    from ruamel.yaml import YAML
    from ruamel.yaml.events import (
        AliasEvent,
        CollectionEndEvent,
        CollectionStartEvent,
        MappingEndEvent,
        ScalarEvent,
    )

    open_nodes: list[list[object]] = [[]]
    for event in YAML(typ="base", pure=True).parse(text):
        if isinstance(event, AliasEvent):
            raise InputError("it has an alias (*), which a bag does not need")
        if isinstance(event, CollectionStartEvent):
            open_nodes.append([])
            if len(open_nodes) > DEEPEST + 1:
                raise InputError(f"it has more than {DEEPEST} lists or tables within one another")
        elif isinstance(event, CollectionEndEvent):
            parts = open_nodes.pop()
            is_table = isinstance(event, MappingEndEvent)
            open_nodes[-1].append(dict(zip(parts[::2], parts[1::2], strict=True)) if is_table else parts)
        elif isinstance(event, ScalarEvent):
            open_nodes[-1].append(event.value)
    return open_nodes[0][0] if open_nodes[0] else None


def _content(path: Path, left: int) -> bytes:
    """Return a file of a bag, unpacked, if it has at most `left` bytes."""
    packed = path.suffix == _PACKED
    try:
        content = read_bytes(path, largest=left)
    except InputError:
        if path.is_file() and path.stat().st_size > left:
            raise _too_large(path.parent) from None
        raise
    if packed:
        import zstandard

        try:
            content = zstandard.ZstdDecompressor().stream_reader(content).read(left + 1)
        except zstandard.ZstdError as error:
            raise InputError(f"{path} cannot be read: it cannot be unpacked: {error}.") from None
        if len(content) > left:
            raise _too_large(path.parent)
    return content


def _too_large(folder: Path) -> InputError:
    return InputError(
        f"{folder} has more than {format_bytes(LARGEST_TABLE)} in its files; split it with ros2 bag convert."
    )
