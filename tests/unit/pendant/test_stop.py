"""STOP of the pendant when its ways to the arm are cut: a bridge that goes and comes, a servo that does not answer."""

from __future__ import annotations

import asyncio
import shlex
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from qrobot.config.deployment import BridgeChoice, deployment_path, load_deployment
from qrobot.pendant import arm_watch
from qrobot.pendant.arm_station import ArmStation
from qrobot.pendant.arm_watch import ArmWatch
from qrobot.servo.operator.sockets import control_name
from qrobot.wire import ClientRole, Connection, Hello, RobotState, Side, State, Stop, Welcome
from tests.support.patience import PATIENCE_S
from tests.support.puma import ROBOT

pytestmark = pytest.mark.realtime

Q = tuple(ROBOT.poses["end"].tolist())
STATE = State(1, RobotState(t_ns=0, mode=5, q=Q, v=(0.0,) * 6, tau=(0.0,) * 6, q_setpoint=Q))


class Bridge:
    """A bridge that lets everybody look, and writes down who asks for a stop."""

    def __init__(self) -> None:
        self.port = 0
        self.stops: list[Stop] = []
        self._writers: list[asyncio.StreamWriter] = []

    async def begin(self) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def end(self) -> None:
        self._server.close()
        for writer in self._writers:
            writer.transport.abort()
        await self._server.wait_closed()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        connection = Connection(Side.SERVER)
        while data := await reader.read(4096):
            connection.receive_data(data)
            while (event := connection.next_event()) is not None:
                if isinstance(event, Hello):
                    writer.write(connection.send(Welcome(ClientRole.OBSERVER, ROBOT.name, 6, event.period_us)))
                    writer.write(connection.send(STATE))
                elif isinstance(event, Stop):
                    self.stops.append(event)


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.001)


def test_stop_and_power_off_go_by_the_bridge_too_and_the_page_is_told_what_is_sure(
    runtime_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The servo's control socket takes requests and answers none; the bridge goes, and comes back."""
    monkeypatch.setattr(arm_watch, "RETRY_S", 0.01)
    monkeypatch.setattr(arm_watch, "SILENCE_S", PATIENCE_S)
    arm = load_deployment("emulator").arm[0]

    async def story(bridge: Bridge) -> None:
        await bridge.begin()
        moved = arm.model_copy(update={"bridge": BridgeChoice(port=bridge.port)})
        station = ArmStation(moved, ROBOT, (0.0, 0.0, 0.0), tmp_path / "t.db", lambda _: None, lambda: None)
        watching = asyncio.create_task(station.watch.run())
        await until(lambda: not station.watch.problem)
        station.stop()
        await until(lambda: bridge.stops == [Stop()])
        station.act("power off")
        await until(lambda: bridge.stops[1:] == [Stop(power_off=True)])
        await until(lambda: station.status["notices"] == 2)
        assert "was sent by the bridge; watch that the arm stands" in station.status["notice"]
        await bridge.end()
        await until(lambda: "start it with `qrobot up" in station.watch.problem)
        station.stop()
        await until(lambda: station.status["notices"] == 3)
        assert "HAS NOT REACHED THE ARM: press the emergency stop" in station.status["notice"]
        await bridge.begin()
        await until(lambda: not station.watch.problem)
        station.stop()
        await until(lambda: len(bridge.stops) == 3)
        watching.cancel()
        await bridge.end()

    with socket.socket(socket.AF_UNIX) as hung:
        hung.bind(str(runtime_folder / control_name(arm.name)))
        hung.listen()
        asyncio.run(story(Bridge()))


def test_another_arm_at_the_address_is_not_shown_but_can_be_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QROBOT_TOKEN", f"{'a' * 64}:cell")
    arm, told = load_deployment("emulator").arm[0], list[State]()

    async def story(bridge: Bridge) -> None:
        await bridge.begin()
        watch = ArmWatch(
            arm.model_copy(update={"bridge": BridgeChoice(port=bridge.port)}), ROBOT, told.append, lambda: None
        )
        watching = asyncio.create_task(watch.run())
        await until(lambda: f"is the bridge of arm cell, not of {arm.name}" in watch.problem)
        assert watch.ask_stop()
        await until(lambda: bridge.stops == [Stop()])
        watching.cancel()
        await bridge.end()

    asyncio.run(story(Bridge()))
    assert told == []


@pytest.mark.parametrize("deployment", ["two_arms", "a folder/cell.toml"])
def test_the_command_that_starts_an_arm_which_is_not_there_names_the_deployment(
    deployment: str, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a folder").mkdir()
    Path("a folder/cell.toml").write_text(deployment_path("two_arms").read_text())
    watch = ArmWatch(load_deployment(deployment).arm[1], ROBOT, print, print, deployment)
    told = shlex.split(watch._why(OSError()).split("`")[1])
    assert told[:2] == ["qrobot", "up"]
    assert load_deployment(told[2]) == load_deployment(deployment)


class SilentClient:
    """The watch's end of a line on which no whole packet comes."""

    def take(self, data: bytes) -> None:
        assert data

    def pop_welcome(self) -> None:
        return None

    def pop_state(self) -> None:
        return None


def test_a_watch_that_is_cancelled_ends_also_at_the_instant_at_which_something_is_heard() -> None:
    async def is_cancelled(turns: int) -> bool:
        reader, watch = asyncio.StreamReader(), ArmWatch(load_deployment("emulator").arm[0], ROBOT, print, print)
        hearing = asyncio.create_task(watch._hear(SilentClient(), reader))  # type: ignore[arg-type]
        await asyncio.sleep(0.01)
        reader.feed_data(b"half a packet")
        for _ in range(turns):  # of the loop, until the task has noticed
            await asyncio.sleep(0)
        if hearing.done():
            return True
        hearing.cancel()
        await asyncio.wait([hearing])
        return hearing.cancelled()

    assert [asyncio.run(is_cancelled(turns)) for turns in range(6)] == [True] * 6


class StrangeClient(SilentClient):
    """A line to a bridge of some robot that tells a sample with everything that is read."""

    def __init__(self, robot: str, n: int) -> None:
        self._welcome: list[Welcome] = [Welcome(ClientRole.OBSERVER, robot, n, arm_watch.PERIOD_US)]

    def pop_welcome(self) -> Welcome | None:  # type: ignore[override]
        return self._welcome.pop() if self._welcome else None

    def pop_state(self) -> State:  # type: ignore[override]
        return STATE


@pytest.mark.parametrize(("robot", "n"), [("stanford", 6), (ROBOT.name, 7)])
def test_the_arm_of_another_robot_is_not_shown_as_that_of_the_deployment(robot: str, n: int) -> None:
    async def heard(robot: str, n: int) -> tuple[list[State], str]:
        told: list[State] = []
        watch = ArmWatch(load_deployment("emulator").arm[0], ROBOT, told.append, lambda: None)
        reader, client = asyncio.StreamReader(), StrangeClient(robot, n)
        for _ in range(2):
            reader.feed_data(b"a packet")
            await watch._hear(client, reader)  # type: ignore[arg-type]
        return told, watch.problem

    assert asyncio.run(heard(ROBOT.name, ROBOT.n)) == ([STATE, STATE], "")
    told, problem = asyncio.run(heard(robot, n))
    assert told == []
    for each in (f"'{robot}' with {n} joints", f"'{ROBOT.name}' with 6", "--deployment"):
        assert each in problem
