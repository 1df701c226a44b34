"""Messages of ROS 1 bags, ROS 2 bags and MCAP files, read one after the other and never all at once. Needs the extra ``bags``.

The formats and message types are read by ``rosbags``. A file that was cut off has no index any more; what is whole in it is read in
the order it was written in.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.datasets.recordings.ros.messages import read_through

#: Topic, time that it was recorded at in nanoseconds, and the serialized message.
Raw = tuple[str, int, bytes]


class Bag:
    """A bag: which topics there are, and their messages.

    Parameters
    ----------
    path : Path
        A ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a ROS 2 bag.

    Attributes
    ----------
    topics : dict of str to str
        Type of each topic, such as ``sensor_msgs/msg/Image``.
    notes : list of str
        What the user should know: a file that was cut off.

    Raises
    ------
    DatasetError
        Not a bag, or nothing in it can be read; the extra ``bags`` is missing.
    """

    def __init__(self, path: Path) -> None:
        if importlib.util.find_spec("rosbags") is None:
            raise DatasetError(f'{path}: reading bags needs rosbags and mcap; install them: pip install "panoloc-mcl[bags]"')
        self.path = path
        self.notes: list[str] = []
        self.topics: dict[str, str] = {}
        self._read: Callable[[Collection[str], int | None], Iterator[Raw]]
        self._decode: Callable[[bytes, str], Any]
        try:
            self._open_whole()
        except Exception as error:  # whatever a damaged file does to its reader
            self._open_cut_off(error)

    def _open_whole(self) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        reader = AnyReader([self.path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
        self._reader = reader
        self.topics = {connection.topic: connection.msgtype for connection in reader.connections}

        def read(topics: Collection[str], start_ns: int | None) -> Iterator[Raw]:
            chosen = [connection for connection in reader.connections if connection.topic in topics]
            if chosen:
                for connection, time, raw in reader.messages(chosen, start=start_ns):
                    yield connection.topic, time, raw

        self._read, self._decode = read, reader.deserialize

    def _open_cut_off(self, reason: Exception) -> None:
        from panoloc_mcl.tools.datasets.recordings.ros.salvage import salvaged

        try:
            found = salvaged(self.path)
        except Exception:  # such as types that contradict each other
            found = None
        if found is None:
            text = " ".join(str(reason).split()) or type(reason).__name__
            raise DatasetError(
                f"{self.path}: not a bag that can be read ({text}); check the file, or record it again"
            ) from reason
        self.topics, self._decode = found.topics, found.decode
        self._read = lambda topics, start_ns: found.messages(topics)
        if found.unknown:
            self.notes.append(f"{self.path.name}: types of {', '.join(found.unknown)} cannot be read; left out")
        else:
            self.notes.append(f"{self.path.name}: was cut off; what is whole in it is used")

    def messages(self, topics: Collection[str], start_ns: int | None = None) -> Iterator[Raw]:
        """Messages of some topics, recorded at a time or later if the file has an index, in the order of the bag.

        A damaged place ends them, with a note.
        """
        count = 0
        try:
            for message in self._read(topics, start_ns):
                count += 1
                yield message
        except GeneratorExit:
            raise
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            note = f"{self.path.name}: is damaged ({text}); what comes before that is used"
            if note not in self.notes:
                self.notes.append(note)

    def decoded(self, topic: str, raw: bytes) -> Any:
        """A message as an object with the fields of its type.

        Raises
        ------
        ValueError
            The bytes are not such a message.
        """
        try:
            message = self._decode(raw, self.topics[topic])
            # A bag brings the definitions of its types with it; a damaged one gives messages without their fields.
            read_through(message, self.topics[topic])
            return message
        except Exception as error:
            raise ValueError(f"a message of {topic} is damaged ({type(error).__name__})") from error
