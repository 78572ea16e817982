"""A viewer: it subscribes to all channels of a websocket, and decodes messages by their schemas."""

import base64
import json
import socket
import struct
import threading

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from wsproto import ConnectionType, WSConnection
from wsproto.events import AcceptConnection, BytesMessage, Ping, Request, TextMessage


def decoder(name, data):
    """A function that decodes messages of a type, described by a FileDescriptorSet."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(data).file:
        pool.Add(file)
    found = pool.FindMessageTypeByName(name)
    if hasattr(message_factory, "GetMessageClass"):
        return message_factory.GetMessageClass(found).FromString
    return message_factory.MessageFactory(pool).GetPrototype(found).FromString


def read_mcap(path):
    """Messages of an MCAP file by channel, as pairs of time [ns] and decoded message."""
    found, decoders = {}, {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert (channel.message_encoding, schema.encoding) == ("protobuf", "protobuf")
            if schema.id not in decoders:
                decoders[schema.id] = decoder(schema.name, schema.data)
            content = decoders[schema.id](message.data)
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


class Client:
    """Receives everything that a server sends, in a thread."""

    def __init__(self, port):
        self.channels, self.messages = {}, {}  # by topic: description; pairs as of read_mcap
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self._connection = WSConnection(ConnectionType.CLIENT)
        self._decoders, self._parts, self._open = {}, [], True
        ask = Request(host="localhost", target="/", subprotocols=["foxglove.sdk.v1"])
        self._socket.sendall(self._connection.send(ask))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self):
        self._open = False
        self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()

    def _run(self):
        self._socket.settimeout(None)
        while True:
            try:
                data = self._socket.recv(1 << 16)
                self._connection.receive_data(data or None)
                for event in self._connection.events():
                    self._take(event)
            except OSError:
                return
            if not data:
                return

    def _take(self, event):
        if isinstance(event, AcceptConnection):
            assert event.subprotocol == "foxglove.sdk.v1"
        elif isinstance(event, Ping) and self._open:
            self._socket.sendall(self._connection.send(event.response()))
        elif isinstance(event, (TextMessage, BytesMessage)):
            self._parts.append(event.data)
            if event.message_finished:
                whole, self._parts = type(event.data)().join(self._parts), []
                self._take_text(json.loads(whole)) if isinstance(whole, str) else self._take_data(whole)

    def _take_text(self, message):
        if message["op"] != "advertise":
            return
        wanted = []
        for channel in message["channels"]:
            assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
            schema = base64.b64decode(channel["schema"] + "==")
            self.channels[channel["topic"]] = channel
            self._decoders[channel["id"]] = channel["topic"], decoder(channel["schemaName"], schema)
            wanted.append({"id": channel["id"], "channelId": channel["id"]})
        text = json.dumps({"op": "subscribe", "subscriptions": wanted})
        self._socket.sendall(self._connection.send(TextMessage(data=text)))

    def _take_data(self, data):
        if data[0] == 1:
            subscription, time = struct.unpack_from("<IQ", data, 1)
            topic, decode = self._decoders[subscription]
            self.messages.setdefault(topic, []).append((time, decode(data[13:])))
