# SPDX-License-Identifier: Apache-2.0
"""Our RTDE client and codec on packages of Universal Robots' own, byte for byte.

The packages are those that the unit tests of UR's client library give as bytes, with the meaning stated there
(UniversalRobots/Universal_Robots_Client_Library, tests/test_rtde_*.cpp). That of a set-up of outputs states a size that
is two short there; it has the right one here.
"""

import socket

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_driver.robot.link import LinkError
from seed_driver.robot.rtde_client import RtdeClient
from seed_ur import rtde

ACCEPTED = "0004 56 01"
VERSION = "0013 76 00000005 0000000c 00000002 00000000"
DATA = (
    "003c 55 01 40d0758c49ba5e35 bff99c77d110b460 bffba233d110b460 c0019fbe68885a30 bfe9db22a22168c0 3ff98587a0000000"
    "bf9fbe74442d1800"
)
JOINTS = (-1.6007, -1.7271, -2.203, -0.808, 1.5951, -0.031)  # [rad]


class Scripted:
    """A connection that answers with given packages, one a request, and keeps what was sent."""

    def __init__(self, *answers: str) -> None:
        self.answers, self.sent = [bytes.fromhex(a) for a in answers], b""
        self._waiting = b""

    def sendall(self, data: bytes) -> None:
        self.sent += data
        self._waiting += self.answers.pop(0) if self.answers else b""

    def recv(self, size: int) -> bytes:
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture
def connect(monkeypatch):
    def made(*answers: str) -> tuple[RtdeClient, Scripted]:
        connection = Scripted(ACCEPTED, VERSION, *answers)
        monkeypatch.setattr(socket, "create_connection", lambda *_: connection)
        return RtdeClient("robot"), connection

    return made


def test_greeting_is_urs(connect) -> None:
    client, connection = connect()
    assert connection.sent == bytes.fromhex("0005 56 0002  0003 76")
    assert client.version == (5, 12, 2, 0)


def test_a_refused_protocol_is_named(monkeypatch) -> None:
    monkeypatch.setattr(socket, "create_connection", lambda *_: Scripted("0004 56 00"))
    with pytest.raises(LinkError, match="refuses RTDE protocol 2"):
        RtdeClient("robot")


def test_outputs_are_asked_for_and_read_as_urs_library_does(connect) -> None:
    kinds = b"DOUBLE,VECTOR6D".hex()
    client, connection = connect(f"0013 4f 01 {kinds}", "0004 53 01" + DATA)
    before = len(connection.sent)
    client.start(("timestamp", "actual_q"), 500.0)
    names = b"timestamp,actual_q".hex()
    assert connection.sent[before:] == bytes.fromhex(f"001d 4f 407f400000000000 {names}  0003 53")
    assert client.values["timestamp"] == pytest.approx(16854.1919, abs=1e-4)
    assert_allclose(client.values["actual_q"], JOINTS, atol=1e-4)


def test_an_output_that_is_not_found_is_named(connect) -> None:
    kinds = b"NOT_FOUND,VECTOR6D".hex()
    client, _ = connect(f"0016 4f 00 {kinds}")
    with pytest.raises(LinkError, match="does not know the RTDE output timestamp"):
        client.start(("timestamp", "actual_q"), 500.0)


def test_an_optional_output_that_is_not_found_is_done_without(connect) -> None:
    """As `payload_cog` of a release that does not tell it yet."""
    client, connection = connect(
        "001d 4f 00" + b"DOUBLE,NOT_FOUND,VECTOR6D".hex(),
        "0013 4f 01" + b"DOUBLE,VECTOR6D".hex(),
        "0004 53 01" + DATA,
    )
    client.start(("timestamp", "payload_cog", "actual_q"), 500.0, optional=("payload_cog",))
    names = b"timestamp,actual_q".hex()
    assert connection.sent.endswith(bytes.fromhex(f"001d 4f 407f400000000000 {names}  0003 53"))
    assert client.values.keys() == {"timestamp", "actual_q"}
    assert_allclose(client.values["actual_q"], JOINTS, atol=1e-4)


def test_an_output_that_is_not_found_and_not_optional_is_named_all_the_same(connect) -> None:
    client, _ = connect("001e 4f 00" + b"NOT_FOUND,NOT_FOUND,DOUBLE".hex(), "0014 4f 00" + b"NOT_FOUND,DOUBLE".hex())
    with pytest.raises(LinkError, match="does not know the RTDE output timestamp"):
        client.start(("timestamp", "payload_cog", "payload"), 500.0, optional=("payload_cog", "payload"))


def test_an_answer_without_one_of_the_types_is_named(connect) -> None:
    client, _ = connect("000a 4f 01" + b"DOUBLE".hex())
    with pytest.raises(LinkError, match=r"robot tells 1 types of 2 RTDE outputs \(DOUBLE\): is it a UR controller"):
        client.start(("timestamp", "actual_q"), 500.0)


@pytest.mark.parametrize(
    ("answer", "free"), [("0011 49 01" + b"UINT32,DOUBLE".hex(), True), ("0011 49 00" + b"IN_USE,IN_USE".hex(), False)]
)
def test_inputs_are_asked_for_as_urs_library_does(connect, answer: str, free: bool) -> None:
    client, connection = connect(answer)
    before = len(connection.sent)
    assert client.take_inputs("speed_slider_mask", "speed_slider_fraction") is free
    names = b"speed_slider_mask,speed_slider_fraction".hex()
    assert connection.sent[before:] == bytes.fromhex(f"002a 49 {names}")


def test_data_are_packed_and_unpacked_as_urs_library_does() -> None:
    mask = rtde.Recipe.of(("speed_slider_mask",), rtde.INPUTS)
    assert mask.encode(1, {"speed_slider_mask": 1}) == bytes.fromhex("0008 55 01 00000001")
    recipe = rtde.Recipe.of(("timestamp", "target_speed_fraction"), rtde.OUTPUTS)
    (package,) = rtde.unpack_stream(bytearray.fromhex("0014 55 01 40d0070d2f1a9fbe 3ff0000000000000"))
    assert recipe.decode(package.payload[1:]) == {"timestamp": 16412.206, "target_speed_fraction": 1.0}
    assert recipe.decode(bytes.fromhex("40d0758c49ba5e35bf")) is None  # too short


def test_packages_of_unknown_kinds_pass_and_false_sizes_wait() -> None:
    assert list(rtde.unpack_stream(bytearray.fromhex("0005 02 0000"))) == [rtde.Package(2, b"\0\0")]
    short = bytearray.fromhex("0006 02 0000")
    assert list(rtde.unpack_stream(short)) == []
    assert len(short) == 5
    assert np.all([len(rtde.pack(k)) == 3 for k in (rtde.START, rtde.PAUSE, rtde.CONTROLLER_VERSION)])
