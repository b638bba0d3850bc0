"""CAN between processes: `qrobot board --serve can=...`, the package canopen at the other end, and the gateway."""

from __future__ import annotations

import subprocess
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import canopen
import numpy as np
import pytest

from qrobot.config.deployment import load_deployment
from qrobot.hwif.board_memory import attach_board_memory, fetch_image
from qrobot.hwif.canbus.interface import open_interface
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, make_image
from qrobot.hwif.registers import ENC_COUNT, STATUS, STATUS_POWER
from qrobot.rig.processes import board_ready
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import free_port, qrobot

pytestmark = pytest.mark.realtime

EDS = str(Path(__file__).parents[2] / "config/can/qrobot_board.eds")
COLD_S = 5.0 * PATIENCE_S
ARMS = """
[[arm]]
name = "{far}"
robot = "puma560"
bridge = {{ port = 5701 }}
[[arm]]
name = "{near}"
robot = "puma560"
bridge = {{ port = 5702 }}
servo = {{ rate_hz = 200, guardian_timeout_ms = 100, board_timeout_ms = 100 }}
[arm.board]
kind = "can"
can = {{ interface = "udp_multicast", channel = "{channel}", period_ms = 5, timeout_ms = 500 }}
"""


class Far:
    """The emulated board's process, and the deployment file of a gateway to it."""

    def __init__(self, path: Path) -> None:
        self.deployment = path
        self.far, self.near = (arm.name for arm in load_deployment(path).arm)
        self.channel = load_deployment(path).arm[1].board.can.channel  # type: ignore[union-attr]
        self.process = qrobot("board", path, "--arm", self.far, "--serve", f"can=udp_multicast:{self.channel}")


@pytest.fixture(scope="module")
def far(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Far]:
    path = tmp_path_factory.mktemp("can") / "arms.toml"
    ident = uuid.uuid4().hex[:10]
    path.write_text(ARMS.format(far=f"f{ident}", near=f"n{ident}", channel=f"239.74.163.2/{free_port()}"))
    far = Far(path)
    wait_until(lambda: board_ready(far.far), "the board runs", COLD_S)
    yield far
    end(far.process)


def end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.communicate(timeout=PATIENCE_S)


def inputs_of(arm: str) -> np.ndarray:
    """Input words in the newest image of a board, past its transport."""
    segment = attach_board_memory(arm)
    image = make_image()
    assert fetch_image(segment.memory, image)
    segment.close()
    return image[IMAGE_INPUTS:]


def counts_of(arm: str) -> np.ndarray:
    return inputs_of(arm)[ENC_COUNT // 2 :][:6]


def asked_until(condition: Callable[[], bool], what: str) -> None:
    """Ask the node again and again: a busy machine loses a datagram of this bus, of a request or an answer."""

    def holds() -> bool:
        try:
            return condition()
        except canopen.SdoCommunicationError:
            return False

    wait_until(holds, what)


def test_the_package_canopen_reads_counts_and_moves_a_joint_of_the_emulated_arm(far: Far) -> None:
    network = canopen.Network(open_interface("udp_multicast", far.channel))
    network.connect()
    try:
        board = network.add_node(1, EDS)
        board.sdo.RESPONSE_TIMEOUT = 0.5
        asked_until(lambda: bool(board.sdo[0x1000].raw), "the node answers: it starts after the board")
        counts: list[int] = []

        def all_counts() -> bool:
            counts[:] = [board.sdo["ENC_COUNT"][joint].raw for joint in range(1, 7)]
            return counts == counts_of(far.far).tolist()

        asked_until(all_counts, "the counts of the board")
        board.nmt.state = "OPERATIONAL"
        network.sync.start(0.01)

        def waist_moves() -> bool:
            """Ask again each time: on a machine that stalls the watchdog may have acted meanwhile."""
            board.sdo[0x6300][1].raw = 0x0007  # arm power, hand relaxed
            board.sdo[0x6411][1].raw = 13107  # 4 V turn the waist
            return abs(int(board.sdo["ENC_COUNT"][1].raw) - counts[0]) > 200

        asked_until(waist_moves, "the waist moves")
        network.sync.stop()
        wait_until(lambda: not inputs_of(far.far)[STATUS // 2] & STATUS_POWER, "the watchdog acts when nobody speaks")
    finally:
        network.disconnect()


def test_the_gateway_shows_the_far_board_under_the_near_arms_name(far: Far) -> None:
    gateway = qrobot("board", far.deployment, "--arm", far.near)
    try:
        wait_until(lambda: board_ready(far.near), "the far board is found", COLD_S)
        assert counts_of(far.near).tolist() == counts_of(far.far).tolist()
        segment = attach_board_memory(far.near)
        image = make_image()
        fetch_image(segment.memory, image)
        before = int(image[IMAGE_COUNT])
        wait_until(lambda: fetch_image(segment.memory, image) and image[IMAGE_COUNT] > before, "new images")
        segment.close()
    finally:
        end(gateway)
