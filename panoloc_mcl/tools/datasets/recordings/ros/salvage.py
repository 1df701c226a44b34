"""Bags that were cut off: no index, so they are read from the front until something is missing."""

from __future__ import annotations

import bz2
import itertools
import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

_ROS1_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 0x02, 0x05, 0x07

#: Topic, type, definition, time in nanoseconds, bytes.
_Found = tuple[str, str, str, int, bytes]


@dataclass(frozen=True)
class Salvaged:
    """What is left of a bag: its topics with their types, how its messages are decoded, and the messages again from the front.

    ``unknown`` are topics whose types cannot be read.
    """

    topics: dict[str, str]
    decode: Callable[[bytes, str], Any]
    read: Callable[[], Iterator[_Found]]
    unknown: tuple[str, ...] = ()

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Those of some topics, in the order that they were written in."""
        for topic, _, _, time, raw in self.read():
            if topic in topics:
                yield topic, time, raw


def _salvaged(read: Callable[[], Iterator[_Found]], ros1: bool) -> Salvaged:
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    topics: dict[str, str] = {}
    types: dict[str, Any] = {}
    unknown: list[str] = []
    for topic, kind, definition, _, _ in read():
        if topic not in topics and topic not in unknown:
            try:
                types.update(get_types_from_msg(definition, kind))
            except TypesysError:
                unknown.append(topic)
                continue
            topics[topic] = kind
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return Salvaged(topics, store.deserialize_ros1 if ros1 else store.deserialize_cdr, read, tuple(unknown))


def salvaged_ros1(path: Path) -> Salvaged | None:
    """A ROS 1 bag; None if it is none."""
    with path.open("rb") as stream:
        if stream.read(len(_ROS1_MAGIC)) != _ROS1_MAGIC:
            return None
    return _salvaged(lambda: _until_damage(_ros1(path)), ros1=True)


def salvaged_mcap(path: Path) -> Salvaged | None:
    """An MCAP file with ROS 2 messages; None if it is none."""
    with path.open("rb") as stream:
        if not stream.read(8).startswith(b"\x89MCAP"):
            return None
    return _salvaged(lambda: _until_damage(_mcap(path)), ros1=False)


def salvaged_sqlite(path: Path) -> Salvaged | None:
    """A database of ROS 2; None if it is none."""
    with path.open("rb") as stream:
        if stream.read(16) != b"SQLite format 3\0":
            return None
    from rosbags.typesys import Stores, get_typestore

    # Types are those of the standard: older databases do not hold their definitions.
    store = get_typestore(Stores.ROS2_HUMBLE)
    topics = {topic: kind for topic, kind, _, _, _ in _until_damage(_sqlite(path)) if kind in store.types}
    return Salvaged(topics, store.deserialize_cdr, lambda: _until_damage(_sqlite(path)))


_SALVAGED: dict[str, Callable[[Path], Salvaged | None]] = {
    ".bag": salvaged_ros1,
    ".mcap": salvaged_mcap,
    ".db3": salvaged_sqlite,
}


def salvaged(path: Path) -> Salvaged | None:
    """What is left of a bag, be it a file or a folder with files; None if nothing is."""
    files = [path] if path.is_file() else sorted(path.iterdir())
    found = [_SALVAGED[file.suffix](file) for file in files if file.suffix in _SALVAGED]
    parts = [part for part in found if part is not None]
    topics = {topic: kind for part in parts for topic, kind in part.topics.items()}
    if not topics:
        return None
    unknown = tuple(dict.fromkeys(topic for part in parts for topic in part.unknown))
    return Salvaged(topics, parts[0].decode, lambda: itertools.chain.from_iterable(part.read() for part in parts), unknown)


def _until_damage(found: Iterator[_Found]) -> Iterator[_Found]:
    """Messages up to the first place that is missing or damaged, whatever that does to its reader."""
    try:
        yield from found
    except Exception:
        return


def _sqlite(path: Path) -> Iterator[_Found]:
    import apsw

    base = apsw.Connection(path.absolute().as_uri() + "?immutable=1", flags=_READ_ONLY, vfs=_whole_pages(path))
    try:
        # A file that is shorter than its head says is refused otherwise; it is open for reading alone.
        base.execute("PRAGMA writable_schema = ON")
        topics = {number: (name, kind) for number, name, kind in base.execute("SELECT id, name, type FROM topics")}
        for number, stamp, data in base.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id"):
            if number in topics and data is not None:
                yield (*topics[number], "", stamp, _plain(bytes(data)))
    finally:
        base.close()


# SQLITE_OPEN_READONLY and SQLITE_OPEN_URI.
_READ_ONLY = 0x01 | 0x40


def _whole_pages(path: Path) -> str:
    """The name of a file system in which a database ends with its last whole page: SQLite fills one that is cut with zeros."""
    import apsw

    with path.open("rb") as stream:
        page = int.from_bytes(stream.read(18)[16:], "big")
    page = 65536 if page == 1 else max(page, 512)

    class File(apsw.VFSFile):
        def xFileSize(self) -> int:  # noqa: N802
            return int(super().xFileSize()) // page * page

    class System(apsw.VFS):
        def __init__(self, name: str) -> None:
            super().__init__(name, "")

        def xOpen(self, name: Any, flags: list[int]) -> Any:  # noqa: N802
            return File("", name, flags)

    name = f"panoloc-{page}"
    if name not in _SYSTEMS:
        _SYSTEMS[name] = System(name)
    return name


# By name; they must live as long as anything is open in them.
_SYSTEMS: dict[str, Any] = {}


def _plain(data: bytes) -> bytes:
    """A message that may have been compressed by itself."""
    if data[:4] != b"\x28\xb5\x2f\xfd":
        return data
    import zstandard

    return bytes(zstandard.ZstdDecompressor().decompress(data))


def _mcap(path: Path) -> Iterator[_Found]:
    from mcap.reader import NonSeekingReader

    with path.open("rb") as stream:
        for schema, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
            if schema is not None and schema.encoding == "ros2msg":
                yield channel.topic, schema.name, schema.data.decode(), message.log_time, message.data


def _ros1(path: Path) -> Iterator[_Found]:
    connections: dict[int, tuple[str, str, str]] = {}
    with path.open("rb") as stream:
        stream.seek(len(_ROS1_MAGIC))
        for header, data in _records(stream):
            if header.get(b"op") != bytes([_CHUNK]):
                yield from _ros1_message(header, data, connections)
                continue
            content = _uncompressed(header.get(b"compression", b"none"), data)
            for inner, inner_data in _records_of(content):
                yield from _ros1_message(inner, inner_data, connections)


def _ros1_message(header: dict[bytes, bytes], data: bytes, connections: dict[int, tuple[str, str, str]]) -> Iterator[_Found]:
    kind = header.get(b"op", b"\0")[0]
    if kind == _CONNECTION:
        fields = _fields(data)
        name = fields[b"type"].decode().replace("/", "/msg/")
        connections[_number(header[b"conn"])] = header[b"topic"].decode(), name, fields[b"message_definition"].decode()
    elif kind == _MESSAGE and _number(header[b"conn"]) in connections:
        seconds, nanoseconds = struct.unpack("<II", header[b"time"])
        yield (*connections[_number(header[b"conn"])], seconds * 10**9 + nanoseconds, data)


def _records(stream: IO[bytes]) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """Headers and data, as long as both are whole."""
    while True:
        parts = []
        for _ in range(2):
            length = stream.read(4)
            part = stream.read(_number(length)) if len(length) == 4 else b""
            if len(length) < 4 or len(part) < _number(length):
                return
            parts.append(part)
        yield _fields(parts[0]), parts[1]


def _records_of(content: bytes) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    import io

    return _records(io.BytesIO(content))


def _fields(block: bytes) -> dict[bytes, bytes]:
    fields, at = {}, 0
    while at + 4 <= len(block):
        end = at + 4 + _number(block[at : at + 4])
        name, _, value = block[at + 4 : end].partition(b"=")
        fields[name] = value
        at = end
    return fields


def _number(four: bytes) -> int:
    return int.from_bytes(four[:4], "little")


def _uncompressed(how: bytes, data: bytes) -> bytes:
    if how == b"bz2":
        return bz2.decompress(data)
    if how == b"lz4":
        import lz4.frame

        return bytes(lz4.frame.decompress(data))
    return data
