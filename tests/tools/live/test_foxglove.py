import json
import struct

import numpy as np
import pytest
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from panoloc_mcl.robot.errors import OutputError
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.live import Engine
from panoloc_mcl.tools.live.foxglove_server import FoxgloveServer
from panoloc_mcl.tools.streams import recorded

TOPICS = {"/tf", "/pose", "/particles", "/map", "/panorama", "/status"}


@pytest.mark.slow
def test_a_client_reads_every_topic(small_room: Dataset) -> None:
    drive = small_room.sequences["noon_00"]
    localizer = Localizer(PanoramaMap.build(small_room))
    server = FoxgloveServer(localizer, port=0)
    with pytest.raises(OutputError, match="cannot be served on"):
        FoxgloveServer(localizer, port=server.port)
    with (
        Engine(localizer, [server], keep_all=True) as engine,
        connect(f"ws://127.0.0.1:{server.port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as client,
    ):
        channels: dict[int, str] = {}
        while len(channels) < len(TOPICS):
            message = client.recv(timeout=10.0)
            if isinstance(message, str) and json.loads(message)["op"] == "advertise":
                channels |= {channel["id"]: channel["topic"] for channel in json.loads(message)["channels"]}
        assert set(channels.values()) == TOPICS
        wanted = [{"id": number, "channelId": number} for number in channels]
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        seen: dict[str, bytes] = {}
        messages = iter(recorded(drive))
        while set(seen) != TOPICS:
            engine.put(next(messages))
            engine.drain()
            try:
                while set(seen) != TOPICS:
                    message = client.recv(timeout=0.05)
                    if isinstance(message, bytes) and message[0] == 1:
                        seen[channels[struct.unpack("<I", message[1:5])[0]]] = message[13:]
            except TimeoutError:
                continue
    assert json.loads(seen["/status"])["status"] in ("converged", "searching", "ambiguous")
    assert np.isfinite(json.loads(seen["/status"])["latency_ms"])
