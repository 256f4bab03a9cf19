"""ROS 2 bags as folders, as `ros2 bag record` writes them: metadata.yaml names the files of the recording in order.

A long recording is split into several files (.db3 or .mcap), which are read as one. Files that are compressed as a
whole (.zstd) are unpacked, as far as `ballbot.files` allows; the limit is of all files together.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath

from ballbot.arrays import format_bytes
from ballbot.errors import InputError
from ballbot.files import DEEPEST, LARGEST_SETTINGS, LARGEST_TABLE, folder_refusal, read_bytes, read_text
from ballbot.log.columns import Columns
from ballbot.log.formats.mcap import McapContent, mcap_columns, mcap_messages
from ballbot.log.formats.messages import Topic
from ballbot.log.formats.ros import stored_messages

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
    parts: list[McapContent] = []
    left = LARGEST_TABLE
    for path in bag_files(folder)[1:]:
        content = _content(path, left)
        try:
            parts.append(_messages(path, content))
        except _DAMAGED as error:
            reason = f": {error}" if isinstance(error, InputError) else ""
            raise InputError(
                f"{path} cannot be read: it is not a complete file of a ROS 2 bag{reason}."
            ) from None
        left -= max(len(content), parts[-1].size)
        if left < 0:
            raise _too_large(Path(folder))
    try:
        return mcap_columns(_joined(parts))
    except _DAMAGED as error:
        reason = error if isinstance(error, InputError) else "its messages are damaged"
        raise InputError(f"{folder} cannot be read: {reason}.") from None


def _messages(path: Path, content: bytes) -> McapContent:
    """Return the messages of one file, which is unpacked."""
    if not path.name.removesuffix(_PACKED).endswith(_STORED):
        return mcap_messages(content)
    ros = list(stored_messages(content))
    return McapContent(own=None, topics={}, ros=ros, others=set(), size=sum(len(one.data) for one in ros))


def _joined(parts: Sequence[McapContent]) -> McapContent:
    """Return the messages of the files of a recording, in their order."""
    topics: dict[str, Topic] = {}
    for found in parts:
        for name, one in found.topics.items():
            here = topics.setdefault(name, Topic(name=name))
            here.times += one.times
            here.messages += one.messages
    own = parts[0].own
    return McapContent(
        own=own if all(one.own == own for one in parts) else None,
        topics=topics,
        ros=[message for one in parts for message in one.ros],
        others={encoding for one in parts for encoding in one.others},
        size=sum(one.size for one in parts),
    )


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
            parts = sorted(one.name for one in folder.iterdir() if _is_part(one.name))
        except OSError as error:
            raise InputError(f"{folder} cannot be read: {error.strerror or error}.") from None
        if not parts:
            raise folder_refusal(folder)
        alone = [name for name in parts if not name.endswith(_PACKED)]
        raise InputError(
            f"{folder} is a folder without {METADATA}, which names the files of a ROS 2 bag; write it with: ros2 bag "
            f"reindex {folder}.{f' Or give a file in the folder: {folder / alone[0]}.' if alone else ''}"
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
        if not _is_part(path.name):
            raise InputError(f"{metadata} names {path.name}; files of a bag end in {_STORED} or {_MCAP}.")
        if not path.exists():
            raise InputError(f"{path} is missing; {metadata} names it as a part of the bag.")
    return [metadata, *paths]


def _is_part(name: str) -> bool:
    """Return whether a file's name is that of a part of a bag, packed or not."""
    return PurePath(name.removesuffix(_PACKED)).suffix in (_STORED, _MCAP)


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
