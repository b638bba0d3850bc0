"""The control interface without a loop: messages, sockets and refusals; whatever comes in, nothing moves."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import signal
import socket
import threading
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast, get_args

import numpy as np
import pytest

from qrobot.cli import ctl
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config import Robot, load_robot
from qrobot.config.fences import Fence
from qrobot.errors import ConfigError, LinkBusy, LinkError, LinkLost, LinkTimeout, QRobotError, RemoteProtocolError
from qrobot.faultcodes import FaultCode
from qrobot.fences.fence_set import FenceSet
from qrobot.hwif.board_memory import command_board_memory, create_board_memory, local_board_memory, publish_image
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_T_NS, make_image
from qrobot.modecodes import Mode
from qrobot.model.payload_judge import PayloadJudge
from qrobot.realtime.page_faults import FaultWatch
from qrobot.realtime.structure import view_words
from qrobot.report import QueuedReport
from qrobot.servo.calibration.state import IMPLAUSIBLE, UNJUDGED
from qrobot.servo.event import report_event
from qrobot.servo.laws.law import KP, KV, Law
from qrobot.servo.laws.law_swap import SwapState, fall_back
from qrobot.servo.laws.shipped import LAWS, find_law
from qrobot.servo.memory import mailbox as mailbox_module
from qrobot.servo.memory.commander_lock import Authority
from qrobot.servo.memory.law_history import JournalReader
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import TAKING, attach_servo_memory, create_servo_memory, journal_base
from qrobot.servo.memory.stop_record import Incident, note_incident, read_incident
from qrobot.servo.operator import client as client_module
from qrobot.servo.operator import law_changes, loop_wait
from qrobot.servo.operator import requests as requests_module
from qrobot.servo.operator.board_status import board_status
from qrobot.servo.operator.client import ServoClient
from qrobot.servo.operator.messages import (
    MAX_LINE_BYTES,
    ChangeGains,
    ChangeLaw,
    Clear,
    OperatorRequest,
    PowerOn,
    Reply,
    decode_reply,
    decode_request,
    encode,
)
from qrobot.servo.operator.requests import Controls
from qrobot.servo.operator.sockets import (
    MAX_CLIENTS,
    MAX_WAITING,
    ControlSocket,
    OperatorConnection,
    arms_that_run,
    connect_to_servo,
)
from qrobot.servo.operator.status import servo_status
from qrobot.servo.process.daemon import Look, _Herald, _run_and_watch, _served, serve
from qrobot.servo.process.sole_servo import sole_servo
from qrobot.servo.settings import ServoSettings
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import write_deployment
from tests.support.servo_bench import ServoBench, moving

REQUESTS = ("power", "clears", "stops", "power_offs")


@dataclass
class Bench:
    """A servo bench, as the control interface sees a servo process; a thread ticks it."""

    bench: ServoBench
    arm: str = field(default_factory=lambda: f"t{uuid.uuid4().hex[:10]}")
    robot: Robot = field(default_factory=lambda: load_robot("puma560"))
    law: Law = field(default_factory=lambda: find_law("qrobot", load_robot("puma560")))
    law_name: str = "qrobot"
    said: list[str] = field(default_factory=list)
    page_faults: int = 0
    faults: FaultWatch = field(default_factory=FaultWatch)

    @property
    def mailbox(self) -> ServoMailbox:
        return self.bench.mailbox

    @property
    def settings(self) -> ServoSettings:
        return self.bench.settings

    @property
    def swap(self) -> SwapState:
        return self.bench.state.swap

    @property
    def volts(self) -> Any:
        return self.bench.state.sensors

    @property
    def force_zero(self) -> Any:
        return self.bench.state.force_zero

    @property
    def incident(self) -> Incident | None:
        return read_incident(self.bench.state.watch.incident)

    @property
    def board(self) -> SimpleNamespace:
        return SimpleNamespace(memory=self.bench.board)

    def say(self, message: str) -> None:
        self.said.append(message)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The servo's loop is a thread of ours, which may stall."""
    monkeypatch.setattr(loop_wait, "LOOP_PATIENCE_S", PATIENCE_S)
    for name in ("AT_ONCE_S", "STOP_PATIENCE_S", "RESUMED_S"):
        monkeypatch.setattr(client_module, name, PATIENCE_S)
    monkeypatch.setattr(ServoClient.power_on, "__defaults__", (PATIENCE_S,))
    monkeypatch.setattr(mailbox_module, "_READ_TRIES", round(PATIENCE_S / mailbox_module._READ_PAUSE_S))


@pytest.fixture(scope="module")
def servo() -> Iterator[Bench]:
    """Served and ticked in a thread, for all tests here."""
    process = Bench(ServoBench().tick(5))
    controls = Controls(process)
    done = threading.Event()
    with ControlSocket(process.arm, controls.begin, controls.farewell) as control:

        def tick() -> None:
            while not done.wait(1e-4):  # other tests want the processor
                process.bench.tick(5)

        def serve() -> None:
            while not done.is_set():
                control.serve(0.01)

        threads = [threading.Thread(target=work) for work in (tick, serve)]
        for thread in threads:
            thread.start()
        yield process
        done.set()
        for thread in threads:
            thread.join()


@pytest.fixture
def client(servo: Bench) -> Iterator[ServoClient]:
    with ServoClient(servo.arm) as connection:
        yield connection
        connection.power_off()


def test_the_servo_tells_the_fences_that_it_guards_and_their_distances(
    servo: Bench, client: ServoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert client.fences() == ()
    wall = Fence(name="wall", shape="plane", position_m=(1.0, 0.0, 0.0), rpy_deg=(0.0, -90.0, 0.0), bodies="tool")
    fences = FenceSet(servo.robot, [wall], self_collision=True, self_margin=0.01)
    monkeypatch.setattr(servo.bench, "settings", replace(servo.settings, fences=fences))
    plane, itself = client.fences()
    q = np.array(client.status().q)
    (_, start, end, radius) = fences.capsules_at(q)[-1]
    assert plane.distance_m == pytest.approx(1.0 - max(start[0], end[0]) - radius, abs=1e-12)
    assert (plane.name, plane.body, plane.shape, plane.margin_m) == ("wall", "flange", "plane", 0.02)
    assert (itself.name, itself.shape, itself.margin_m) == ("itself", "capsules", 0.01)
    assert itself.distance_m == fences.distances(q)[1]


def test_the_status_tells_how_the_board_is_reached(servo: Bench, client: ServoClient) -> None:
    names, facts = ("losses", "dropped", "illegal_ops", "module_losses"), servo.bench.board.facts
    for count, name in enumerate(names, 1):
        facts[name] = count
    board = client.status().board
    assert (board.losses, board.dropped, board.illegal, board.module_losses) == (1, 2, 3, 4)
    for name in names:
        facts[name] = 0


def test_the_age_of_the_image_is_told_and_that_there_is_none() -> None:
    memory, image = local_board_memory(), make_image()
    assert board_status(memory, lambda: 5_000_000).age_ms is None
    image[IMAGE_T_NS], image[IMAGE_COUNT] = 2_000_000, 1
    publish_image(memory, image)
    assert board_status(memory, lambda: 5_000_000).age_ms == 3.0


def test_without_an_image_the_servo_is_asked_and_stopped_as_ever(
    client: ServoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Bench, "board", SimpleNamespace(memory=local_board_memory()))
    assert client.status().board.age_ms is None
    assert client.stop().board.age_ms is None
    assert client.power_off().mode == "OFF"


def test_power_does_not_come_later_to_whom_a_standing_loop_was_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    process, visitor = Bench(ServoBench().tick(5)), SimpleNamespace(label="here", gone=threading.Event())

    def loop(condition: Callable[[], bool]) -> None:
        """It runs until power is asked for."""
        if process.mailbox.memory.command.power:
            raise LinkTimeout("the servo's loop does not run")
        process.bench.tick(5)
        assert condition()

    monkeypatch.setattr(requests_module, "await_loop", loop)
    controls = Controls(process)
    answer = decode_reply(controls.answer(cast(Any, visitor), encode(PowerOn())))
    controls.farewell(cast(Any, visitor))
    assert (answer.ok, answer.error) == (False, "the servo's loop does not run")
    process.bench.tick(300)  # it runs again
    assert process.mailbox.snapshot().mode == Mode.OFF


def test_power_does_not_come_to_whoever_has_gone_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    process, visitor = Bench(ServoBench().tick(5)), SimpleNamespace(label="here", gone=threading.Event())

    def loop(_condition: Callable[[], bool]) -> None:
        process.bench.tick(5)
        visitor.gone.set()

    monkeypatch.setattr(requests_module, "await_loop", loop)
    controls = Controls(process)
    answer = decode_reply(controls.answer(cast(Any, visitor), encode(PowerOn())))
    controls.farewell(cast(Any, visitor))
    assert (answer.ok, answer.error) == (False, "whoever asked for arm power has gone: it stays off")
    process.bench.tick(300)
    assert process.mailbox.snapshot().mode == Mode.OFF


def test_the_answer_to_a_clear_tells_the_law_that_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    process, visitor = Bench(ServoBench().tick(5)), SimpleNamespace(label="here", gone=threading.Event())
    for module in (law_changes, requests_module):
        monkeypatch.setattr(module, "await_loop", lambda _condition: process.bench.tick(5))
    controls = Controls(process)
    controls._laws._swap(find_law("pd", process.robot), "pd", process.swap.gains.copy())
    assert process.law_name == "pd"
    fall_back(process.swap)
    answer = decode_reply(controls.answer(cast(Any, visitor), encode(Clear())))
    controls.farewell(cast(Any, visitor))
    assert answer.status is not None
    assert answer.status.law == "qrobot"


def test_power_comes_and_goes_and_the_status_tells(servo: Bench, client: ServoClient) -> None:
    assert client.status().mode == "OFF"
    status = client.power_on()
    assert (status.mode, status.powered, status.robot, status.law) == ("HOLDING", True, "puma560", servo.law_name)
    assert status.q == pytest.approx(servo.robot.poses["park"], abs=1e-3)
    assert "by way of the control interface" in status.commander
    assert client.power_off().mode == "OFF"
    assert client.power_on().mode == "HOLDING"
    assert client.power_on().mode == "HOLDING"  # asked again, nothing happens


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", LAWS)
def test_the_law_changes_while_the_arm_holds(servo: Bench, client: ServoClient, name: str) -> None:
    client.power_on()
    assert client.change_law(name).law == name
    assert ServoMailbox(servo.bench.mailbox.words).info.law == name
    assert servo.said[-1].startswith(f"law {name}, gains")
    assert client.status().mode == "HOLDING"


def test_an_impedance_in_force_takes_other_settings_and_keeps_those_not_named(
    servo: Bench, client: ServoClient
) -> None:
    client.power_on()
    client.change_law("joint_impedance", {"stiffness_1": 300.0})
    servo.bench.state.swap.bias[:] = 0.25  # left as it is: the arm is not held anew
    status = client.change_law("joint_impedance", {"stiffness_2": 500.0})
    assert (status.law_settings["stiffness_1"], status.law_settings["stiffness_2"]) == (300.0, 500.0)
    assert servo.bench.state.swap.settings[2:4].tolist() == [300.0, 500.0]
    assert servo.bench.state.swap.bias.tolist() == [0.25] * servo.robot.n
    with pytest.raises(QRobotError, match=r"CFG_GAIN: law joint_impedance .*less stiffness"):
        client.change_law("joint_impedance", {"stiffness_5": 1700.0, "damping_ratio": 2.0})
    with pytest.raises(QRobotError, match="stiffness_1 = -1 N m/rad: allowed are 0 to"):
        client.change_law("joint_impedance", {"stiffness_1": -1.0})
    assert client.status().law_settings["stiffness_5"] == pytest.approx(0.1 * servo.robot.control.kp[4])
    client.change_law("qrobot")


def test_collisions_can_be_told_sooner_and_never_later_without_authority(servo: Bench, client: ServoClient) -> None:
    asked = (0.5 * servo.robot.guard.unexplained_torque_or_default).tolist()
    client.change_collision(asked, "comply")
    command = servo.bench.mailbox.memory.command
    assert command.collision_thresholds[: servo.robot.n].tolist() == asked
    assert command.collision_reaction == 1
    status = client.status()
    assert (list(status.collision_thresholds), status.collision_reaction) == (asked, "comply")
    with pytest.raises(QRobotError, match="threshold of joint 1: 1000 is more than unexplained_torque"):
        client.change_collision([1000.0, *asked[1:]])
    with pytest.raises(QRobotError, match="2 thresholds for 6 joints"):
        client.change_collision([1.0, 2.0])
    servo.bench.mailbox.forget_collision()  # of a program that has gone; there was none
    assert command.collision_thresholds[: servo.robot.n].tolist() == asked
    servo.bench.mailbox.request_collision(asked, 1, by_program=True)
    servo.bench.mailbox.forget_collision()
    assert (command.collision_thresholds.any(), command.collision_reaction) == (False, 0)
    servo.bench.mailbox.request_collision(asked, 1, by_program=True)
    client.change_collision()
    assert not command.collision_thresholds.any()
    assert command.collision_reaction == 0
    status = client.status()
    assert status.collision_thresholds == tuple(servo.robot.guard.unexplained_torque_or_default)
    assert status.collision_reaction == "stop"


def test_a_payload_is_in_force_when_that_is_answered_also_one_of_the_same_mass(
    servo: Bench, client: ServoClient
) -> None:
    for height_m in (0.1, 0.2):
        assert client.change_payload(1.0, (0.0, 0.0, height_m)).payload_mass == 1.0
        assert servo.bench.state.payload_left_s == 0.0
    client.change_payload(0.0)


def test_a_change_is_in_the_journal_with_the_cycle_it_came_in(servo: Bench, client: ServoClient) -> None:
    journal = JournalReader(servo.bench.mailbox.words, journal_base(servo.robot.n), servo.robot.n)
    client.power_on()
    client.change_law("pd")
    before = list(journal.read())[-1]
    kp = tuple((0.5 * servo.robot.control.kp).tolist())
    tick = client.status().tick
    client.change_gains(kp=kp)
    (entry,) = journal.read()
    assert (entry.law, entry.kp, entry.kv, entry.inertia) == ("pd", kp, before.kv, before.inertia)
    assert before.tick <= tick < entry.tick <= client.status().tick
    assert entry.t_ns - before.t_ns == (entry.tick - before.tick) * servo.bench.settings.period_ns
    client.change_gains(kp=servo.robot.control.kp.tolist())


def test_an_arm_without_a_force_sensor_has_none_to_zero(client: ServoClient) -> None:
    assert client.status().force == (None,) * 6
    with pytest.raises(QRobotError, match="no force sensor"):
        client.zero_force()


def test_an_unknown_law_is_refused_and_the_old_one_stays(client: ServoClient) -> None:
    client.power_on()
    before = client.status().law
    with pytest.raises(QRobotError, match="no control law 'lqr': there are pd"):
        client.change_law("lqr")
    assert client.status().law == before


def test_gains_change_row_by_row_within_reason(servo: Bench, client: ServoClient) -> None:
    client.power_on()
    usual = servo.robot.control
    status = client.change_gains(kp=(0.5 * usual.kp).tolist())
    np.testing.assert_allclose(status.kp, 0.5 * usual.kp)
    np.testing.assert_allclose(status.kv, usual.kv)
    with pytest.raises(QRobotError, match=r"kv of joint 1: .* more than 4 times"):
        client.change_gains(kv=(5.0 * usual.kv).tolist())
    with pytest.raises(QRobotError, match=r"kv of joint 1: .* less than 0.25"):
        client.change_gains(kv=(0.2 * usual.kv).tolist())
    with pytest.raises(QRobotError, match="kp: 2 numbers for 6 joints"):
        client.change_gains(kp=[1.0, 2.0])
    np.testing.assert_allclose(client.change_gains(kv=(0.2 * usual.kv).tolist(), force=True).kv, 0.2 * usual.kv)
    np.testing.assert_allclose(client.change_gains(kp=usual.kp.tolist(), kv=usual.kv.tolist()).kp, usual.kp)


def test_gains_that_are_not_stable_are_refused_by_force_too_and_nothing_changes(
    servo: Bench, client: ServoClient
) -> None:
    client.power_on()
    before, usual = client.status(), servo.robot.control
    for rows in (
        {"kv": (0.0 * usual.kv).tolist()},
        {"kv": (5.0 * usual.kv).tolist()},
        {"kp": (1e5 * usual.kp).tolist()},
    ):
        with pytest.raises(QRobotError, match=r"CFG_GAIN: .*joint 1 \(waist\).*unchecked_gains"):
            client.change_gains(force=True, **rows)
    after = client.status()
    assert (after.mode, after.kp, after.kv, after.q) == (before.mode, before.kp, before.kv, before.q)


def test_one_commands_and_everybody_may_look_stop_and_cut_the_power(servo: Bench, client: ServoClient) -> None:
    client.power_on()
    with ServoClient(servo.arm) as other:
        assert other.status().mode == "HOLDING"
        for act in (other.power_on, other.clear, lambda: other.change_law("pd"), other.calibrate):
            with pytest.raises(QRobotError, match="is commanded by process"):
                act()
        assert other.stop().mode == "HOLDING"
        assert other.power_off().mode == "OFF"
    assert client.power_on().mode == "HOLDING"


VISITOR = cast("OperatorConnection", SimpleNamespace(label="a visitor", gone=threading.Event()))


def one_of_each() -> dict[str, bytes]:
    """A line of every request, by its command."""
    values = {"law": {"name": "pd"}, "override": {"factor": 1.0}, "payload": {"mass": 0.0}}
    commands = [kind.model_fields["command"].default for kind in get_args(get_args(OperatorRequest)[0])]
    return {each: json.dumps({"command": each, **values.get(each, {})}).encode() for each in commands}


@pytest.fixture
def idle_servo() -> tuple[str, Controls]:
    """A servo that nobody serves or ticks: the name of its arm, and what answers its visitors."""
    process = Bench(ServoBench().tick(5))
    return process.arm, Controls(process)


def test_what_anybody_may_ask_for_is_what_the_help_of_ctl_says(idle_servo: tuple[str, Controls]) -> None:
    arm, controls = idle_servo
    holder = Authority(arm)
    holder.take("somebody")
    try:
        replies = {command: controls.begin(VISITOR, line) for command, line in one_of_each().items()}
    finally:
        holder.release()
    refused = {each for each, reply in replies.items() if isinstance(reply, bytes)}
    assert all(b"is commanded by somebody" in replies[each] for each in refused)
    assert set(replies) - refused == {"status", "fences", *re.findall("`([a-z ]+)`", ctl.HELP)}


def test_the_thread_that_reads_stops_waits_for_no_state_that_the_loop_may_be_writing(
    idle_servo: tuple[str, Controls], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the request is: what has to be read of the loop, or awaited, is left to the thread that answers."""
    _, controls = idle_servo
    for place, name in ((ServoMailbox, "snapshot"), (loop_wait, "comes_true")):
        monkeypatch.setattr(place, name, lambda *_: pytest.fail("it waits for the loop"))
    for line in one_of_each().values():
        assert callable(controls.begin(VISITOR, line))
    controls.farewell(VISITOR)


def test_a_connection_that_ends_frees_the_command_and_leaves_the_power(servo: Bench) -> None:
    with ServoClient(servo.arm) as first:
        first.power_on()
    with ServoClient(servo.arm) as second:
        assert (second.status().mode, second.status().commander) == ("HOLDING", "")
        second.change_law("qrobot")
        second.power_off()


def test_watching_shows_every_change(servo: Bench, client: ServoClient) -> None:
    with ServoClient(servo.arm) as watcher:
        seen = watcher.watch(20.0)
        assert next(seen).mode == "OFF"
        client.power_on()
        assert "HOLDING" in (status.mode for status in seen)


def test_there_is_one_control_socket_an_arm(servo: Bench) -> None:
    with pytest.raises(LinkBusy, match="control socket"):
        ControlSocket(servo.arm, lambda _visitor, line: line, lambda _visitor: None)


def test_an_answer_tells_what_the_loop_did_and_not_what_was_said_of_an_earlier_request(
    servo: Bench, client: ServoClient
) -> None:
    bench = servo.bench
    bench.estop_ok = False
    with pytest.raises(QRobotError, match="no arm power: ESTOP"):
        client.power_on()
    bench.estop_ok = True
    assert client.status().event == FaultCode.ESTOP  # nothing has been asked since
    assert client.power_on().mode == "HOLDING"


def test_a_calibrated_arm_does_not_calibrate_and_says_so(client: ServoClient) -> None:
    for act, mode in ((client.power_off, "OFF"), (client.power_on, "HOLDING")):
        act()
        with pytest.raises(QRobotError, match=f"not in mode {mode}: an arm calibrates under power"):
            client.calibrate()


def test_counters_that_the_potentiometers_contradict_are_given_up_whatever_was_told_last(
    servo: Bench, client: ServoClient
) -> None:
    bench, verdicts = servo.bench, set[int]()  # of every cycle: the cardboard's potentiometers contradict again soon
    client.power_off()
    rows = bench.params.calibration.rows
    rows[0] = 1  # as with a table
    try:
        bench.state.pots.verdict = IMPLAUSIBLE
        wait_until(lambda: bench.snapshot.pots_verdict == IMPLAUSIBLE, "the verdict is told")
        assert not client.status().calibrated
        bench.before.append(lambda _: verdicts.add(bench.snapshot.pots_verdict))
        assert client.calibrate().mode == "OFF"
        wait_until(lambda: UNJUDGED in verdicts, "the counters are read anew")
    finally:
        rows[0] = 0
        bench.before.clear()
    assert client.power_on().mode == "HOLDING"  # the cardboard shows them as calibrated whatever it is told


def test_a_mistake_of_ours_is_an_answer_and_the_servo_goes_on(
    servo: Bench, client: ServoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.power_on()
    with monkeypatch.context() as patch:
        patch.setattr(law_changes, "tried_law", lambda *_: 1 / 0)
        with pytest.raises(QRobotError, match="a mistake of this program, told by the servo: ZeroDivisionError"):
            client.change_law("pd")
    assert "Traceback" in servo.said[-1]
    assert client.status().mode == "HOLDING"


def test_a_stop_that_does_not_come_sends_people_to_the_emergency_stop(
    client: ServoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "STOP_PATIENCE_S", 0.1)
    stuck = client.status().model_copy(update={"mode": "TRACKING"})
    with monkeypatch.context() as patch:
        patch.setattr(client, "status", lambda: stuck)
        for act in (client.stop, client.power_off):
            with pytest.raises(LinkTimeout, match=r"still TRACKING after 0\.1 s: use the emergency stop"):
                act()


def test_a_law_is_not_even_loaded_while_the_arm_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    process = Bench(ServoBench().hold())
    moving(process.bench)
    monkeypatch.setattr(law_changes, "tried_law", lambda *_: pytest.fail("loaded"))
    with pytest.raises(QRobotError, match="not in mode TRACKING"):
        Controls(process)._obey(ChangeLaw(name="pd"))


def test_drives_that_close_the_loop_themselves_get_no_law_and_no_gains() -> None:
    process = Bench(ServoBench(position_drives=True))
    for request in (ChangeLaw(name="pd"), ChangeGains(kp=(1.0,) * 6)):
        with pytest.raises(QRobotError, match="it has no law and no gains"):
            Controls(process)._obey(request)


def test_a_visitor_who_is_gone_at_the_door_is_no_trouble(monkeypatch: pytest.MonkeyPatch) -> None:
    class Door:
        def accept(self) -> None:
            raise ConnectionAbortedError

    with ControlSocket(f"t{uuid.uuid4().hex[:10]}", lambda _visitor, line: line, lambda _visitor: None) as door:
        with monkeypatch.context() as patch:
            patch.setattr(door, "_listener", Door())
            door._welcome()
        door.serve(0.0)


# ------------------------------------------------------------------------------- stop and power-off wait for nothing


HANGING = {
    "law": lambda c: c.change_law("pd"),
    "gains": lambda c: c.change_gains(kv=load_robot("puma560").control.kv.tolist()),
    "power on": lambda c: c.power_on(),
    "clear": lambda c: c.clear(),
    "calibrate": lambda c: c.calibrate(),
    "payload": lambda c: c.change_payload(1.0),
    "zero force": lambda c: c.zero_force(),
}


# What of a command may take long, where that is not the wait for the loop.
LONG = {
    "law": (law_changes, "tried_law"),
    "gains": (law_changes, "check_gains"),
    "payload": (PayloadJudge, "objection"),
    "zero force": (requests_module, "zero_force"),
}


@contextlib.contextmanager
def hanging(name: str = "") -> Iterator[tuple[threading.Event, threading.Event]]:
    """Every command hangs from the first event to the second; that of a name where it may take long."""
    began, freed = threading.Event(), threading.Event()

    def hang(*_: object) -> None:
        began.set()
        assert freed.wait(PATIENCE_S)
        raise QRobotError("it hung")

    with pytest.MonkeyPatch.context() as patch:
        place, function = LONG.get(name, (Controls, "_obey"))
        patch.setattr(place, function, hang)
        try:
            yield began, freed
        finally:
            freed.set()


@pytest.mark.parametrize("name", HANGING)
def test_stop_power_off_and_status_are_obeyed_while_every_other_request_hangs(
    servo: Bench, client: ServoClient, name: str
) -> None:
    with ServoClient(servo.arm) as first:
        first.power_on()
    said: list[str] = []

    def command() -> None:
        with ServoClient(servo.arm) as commander:
            try:
                HANGING[name](commander)
            except QRobotError as error:
                said.append(str(error))

    thread = threading.Thread(target=command)
    with hanging(name) as (began, freed):
        thread.start()
        assert began.wait(PATIENCE_S)
        assert client.status().mode == "HOLDING"
        assert client.stop().mode == "HOLDING"
        assert client.power_off().mode == "OFF"
        with ServoClient(servo.arm) as third, pytest.raises(QRobotError, match="is commanded by process"):
            third.change_law("pd")
        assert said == []  # it hangs to the end
        freed.set()
        thread.join()
    assert said == ["it hung"]


def test_a_stop_is_read_while_a_line_about_the_request_before_cannot_be_written(
    servo: Bench, client: ServoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, freed = threading.Event(), threading.Event()

    def say(_line: str) -> None:
        held.set()
        assert freed.wait(PATIENCE_S)

    monkeypatch.setattr(servo, "say", say)
    with ServoClient(servo.arm) as other:
        pausing = threading.Thread(target=other.pause)
        pausing.start()
        assert held.wait(PATIENCE_S)
        stops = int(servo.bench.mail.command.stops)
        try:
            client.stop()
            assert servo.bench.mail.command.stops == stops + 1
            assert pausing.is_alive()
        finally:
            freed.set()
            pausing.join()
        other.resume()


@contextlib.contextmanager
def asking_all_at_once(servo: Bench) -> Iterator[socket.socket]:
    """A connection that waits for as many answers as there are at once, until the block ends."""
    with socket.socket(socket.AF_UNIX) as raw, hanging() as (began, freed), pytest.MonkeyPatch.context() as patch:
        for told in ("_told", "_told_fences"):
            patch.setattr(Controls, told, lambda _self, hang=Controls._obey: hang())
        connect_to_servo(servo.arm, raw)
        raw.sendall(b'{"command": "status"}\n' * MAX_WAITING)
        assert began.wait(PATIENCE_S)
        yield raw
        freed.set()


def test_whoever_asks_for_more_than_is_answered_at_once_keeps_the_command_from_nobody(servo: Bench) -> None:
    line = b'{"command": "clear"}\n'
    with asking_all_at_once(servo) as raw:
        raw.sendall(line)
        raw.settimeout(PATIENCE_S)
        with contextlib.suppress(ConnectionResetError):
            assert raw.recv(100) == b""  # hung up on
    with ServoClient(servo.arm) as other:
        wait_until(lambda: _accepted(other.clear), "the command is free")


def test_a_stop_behind_more_than_is_answered_at_once_is_done(servo: Bench) -> None:
    stops = int(servo.mailbox.memory.command.stops)
    with asking_all_at_once(servo) as raw:
        raw.sendall(b'{"command": "status"}\n{"command": "clear"}\n{"command": "stop"}\n')
        wait_until(lambda: int(servo.mailbox.memory.command.stops) > stops, "it is stopped")


def test_without_a_thread_for_the_reply_the_visitor_is_sent_away_and_the_next_one_served(servo: Bench) -> None:
    def start(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with ServoClient(servo.arm) as unlucky, pytest.MonkeyPatch.context() as patch:
        patch.setattr(threading.Thread, "start", start)
        with pytest.raises(LinkLost):
            unlucky.clear()
    with ServoClient(servo.arm) as other:
        wait_until(lambda: _accepted(other.clear), "the command is free")


def test_a_second_command_is_refused_while_the_first_is_being_done(servo: Bench) -> None:
    with socket.socket(socket.AF_UNIX) as raw, hanging() as (began, freed):
        raw.settimeout(PATIENCE_S)
        connect_to_servo(servo.arm, raw)
        raw.sendall(b'{"command": "law", "name": "pd"}\n')
        assert began.wait(PATIENCE_S)
        raw.sendall(b'{"command": "clear"}\n')
        assert b"another command is still being done" in raw.recv(65536)
        raw.sendall(b'{"command": "stop"}\n')
        assert decode_reply(raw.recv(65536)).ok
        freed.set()
        assert b"it hung" in raw.recv(65536)


def test_whoever_hangs_up_takes_their_law_back_and_frees_the_command(
    servo: Bench, client: ServoClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    began, given_up = threading.Event(), []
    wait_until(lambda: client.status().commander == "", "nobody commands any more")
    before = client.status().law

    def tried(*arguments: object) -> Law:
        began.set()
        given_up.append(arguments[-1].wait(PATIENCE_S))  # type: ignore[attr-defined]
        return find_law("pd" if before != "pd" else "qrobot", servo.robot)

    with socket.socket(socket.AF_UNIX) as raw, monkeypatch.context() as patch:
        patch.setattr(law_changes, "tried_law", tried)
        connect_to_servo(servo.arm, raw)
        raw.sendall(b'{"command": "law", "name": "pd"}\n')
        assert began.wait(PATIENCE_S)
    wait_until(lambda: given_up == [True], "the trial is given up")
    wait_until(lambda: client.status().commander == "", "the command is free")
    wait_until(lambda: _accepted(client.clear), "the next command is done")
    assert client.status().law == before


def _accepted(act: Callable[[], object]) -> bool:
    try:
        act()
    except QRobotError:
        return False
    return True


def test_mute_connections_keep_nobody_out(servo: Bench) -> None:
    mute = [socket.socket(socket.AF_UNIX) for _ in range(3 * MAX_CLIENTS)]
    try:
        for one in mute:
            connect_to_servo(servo.arm, one)
        with ServoClient(servo.arm) as late:
            assert late.power_off().mode == "OFF"
    finally:
        for one in mute:
            one.close()


def test_who_speaks_in_the_moment_in_which_it_makes_room_for_another_takes_nothing_away() -> None:
    arm = f"t{uuid.uuid4().hex[:10]}"
    with (
        ControlSocket(arm, lambda _visitor, line: line + b"\n", lambda _: None) as control,
        contextlib.ExitStack() as stack,
    ):
        clients = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(MAX_CLIENTS + 1)]
        for client in clients[:-1]:
            connect_to_servo(arm, client)
            control.serve(0.0)
        connect_to_servo(arm, clients[-1])
        clients[0].sendall(b"what now\n")
        control.serve(0.0)
        clients[-1].sendall(b"stop\n")
        control.serve(0.0)
        assert clients[-1].recv(100) == b"stop\n"
        with contextlib.suppress(ConnectionResetError):  # hung up on with words of its own unread
            assert clients[0].recv(100) == b""


def test_power_off_of_a_hung_servo_tells_that_the_guardian_has_cut_the_power() -> None:
    process = Bench(ServoBench().hold())
    controls = Controls(process)
    process.bench.mail.guardian.takeover = 1  # and no cycle any more
    ends = socket.socketpair()
    with ends[0], ends[1]:
        reply = decode_reply(controls.answer(OperatorConnection(ends[0]), b'{"command": "power off"}'))
    assert reply.status is not None
    assert (reply.status.mode, reply.status.fault, reply.status.powered) == ("FAULT", FaultCode.GUARD_TRIP, False)
    assert "ctl clear" in reply.status.text  # its loop may come back


def test_a_guardian_that_died_while_it_took_the_board_has_taken_nothing_yet() -> None:
    """Where the servo hangs as well the motors may be driven still: nobody is told that they are not."""
    process = Bench(ServoBench().hold())
    process.bench.mail.guardian.takeover = TAKING
    status = servo_status(process, "")
    assert (status.mode, status.fault, status.powered) == ("HOLDING", FaultCode.NONE, True)


def test_the_status_of_a_servo_that_hangs_says_how_old_its_numbers_are_and_what_to_do() -> None:
    process = Bench(ServoBench().hold())
    front = process.bench.mail
    front.guardian.takeover, front.guardian.t_ns = 1, front.heartbeat.t_ns + 12_300_000_000
    status = servo_status(process, "")
    assert "start it again. What it tells of the arm is 12 s old" in status.text
    assert (status.mode, status.fault) == ("FAULT", FaultCode.GUARD_TRIP)
    assert not status.powered


def test_without_a_servo_the_client_says_what_to_start() -> None:
    with pytest.raises(LinkError, match="no servo of nobody runs here: start it with"):
        ServoClient("nobody")


def test_to_whom_a_servo_of_another_account_refuses_itself_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(errno.EACCES, "its folder is of others")

    monkeypatch.setattr("qrobot.servo.operator.client.connect_to_servo", refuse)
    with pytest.raises(LinkError, match="the servo of left obeys the account that serves it"):
        ServoClient("left")


def test_a_client_of_an_arm_without_a_servo_is_told_which_arms_have_one(runtime_folder: Path) -> None:
    assert arms_that_run() == []
    with ControlSocket("right", print, print), ControlSocket("left", print, print):  # type: ignore[arg-type]
        (runtime_folder / "dead-control").touch()
        assert arms_that_run() == ["left", "right"]
        with pytest.raises(LinkError, match=r"no servo of puma560 .* servos of left, right run: --arm"):
            ServoClient("puma560")


def exchange(servo: Bench, data: bytes) -> bytes:
    """What the servo says to raw bytes, until it hangs up."""
    with socket.socket(socket.AF_UNIX) as raw:
        raw.settimeout(PATIENCE_S)
        connect_to_servo(servo.arm, raw)
        raw.sendall(data)
        raw.shutdown(socket.SHUT_WR)
        answer = b""
        with contextlib.suppress(ConnectionResetError):  # hung up on with words of ours unread
            while part := raw.recv(65536):
                answer += part
        return answer


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        (b"", "EOF"),
        (b"power on", "expected value"),
        (b"[]", "should be an object"),
        (b'{"command": "fly"}', "does not match any of the expected tags"),
        (b'{"command": "power on", "now": true}', "Extra inputs"),
        (b'{"command": "gains", "kp": [1, -2]}', "greater than or equal to 0"),
        (b'{"command": "gains", "kp": [1, Infinity]}', "finite"),
        (b'{"command": "gains", "kp": ["1"]}', "valid number"),
        (b'{"command": "calibrate", "indexes": 99}', "less than or equal to 14"),
        (b'{"command": "law", "name": ""}', "at least 1 character"),
        (b"\xff\xfe{}", "invalid unicode|expected value"),
    ],
)
def test_a_line_that_is_no_request_is_answered_and_changes_nothing(servo: Bench, line: bytes, complaint: str) -> None:
    before = [int(servo.bench.mail.command[name]) for name in REQUESTS]
    with pytest.raises(RemoteProtocolError, match=complaint):
        decode_request(line)
    reply = decode_reply(exchange(servo, line + b"\n"))
    assert not reply.ok
    assert reply.error.startswith("no request: ")
    assert [int(servo.bench.mail.command[name]) for name in REQUESTS] == before


def test_a_line_without_end_is_cut_off(servo: Bench) -> None:
    assert exchange(servo, b"x" * (3 * MAX_LINE_BYTES)) == b""
    with ServoClient(servo.arm) as connection:
        assert connection.status().mode == "OFF"


@dataclass
class Process(Bench):
    """What the daemon's main thread has beside it, with a loop that runs until it is told to end."""

    memory: SimpleNamespace = field(init=False)
    state: Any = field(init=False)
    ended: bool = False
    error: BaseException | None = None

    def __post_init__(self) -> None:
        self.memory = SimpleNamespace(words=self.bench.mailbox.words, front=self.bench.mail)
        self.state = self.bench.state

    @property
    def beat_ns(self) -> int:
        return int(self.memory.front.heartbeat.t_ns)

    def report(self, line: str) -> None:
        self.say(line)

    def check_board(self) -> None:
        """Nothing: it is on the bench."""

    def loop(self) -> None:
        while not self.bench.mail.command.shutdown:
            self.bench.tick()
        self.ended = True


def test_when_the_main_thread_fails_the_loop_ends_in_good_order_first() -> None:
    process = Process(ServoBench())

    def look(*_: object) -> None:
        raise OSError("the disk has gone")

    with pytest.raises(OSError, match="the disk has gone"):
        _run_and_watch(process, look)  # type: ignore[arg-type]
    assert process.ended


def test_a_full_disk_behind_the_lines_for_people_ends_nothing() -> None:
    """`serve` hands the process such a report; stderr is a file on the disk of the logs."""
    tried: list[str] = []

    def note(line: str) -> None:
        tried.append(line)
        raise OSError(errno.ENOSPC, "No space left on device")

    def look(*_: object) -> None:
        if tried:
            process.bench.mail.command.shutdown = 1

    process = Process(ServoBench())
    process.mailbox.request_power(True)
    with QueuedReport(note) as report, pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "report", report)
        _run_and_watch(process, look)  # type: ignore[arg-type]
    assert process.ended
    assert tried[0].startswith("OFF -> ")


def test_a_stop_that_a_full_disk_keeps_from_being_saved_ends_no_servo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The flight recorder's files are on that disk, and so is stderr."""
    tried: list[str] = []
    process = Process(ServoBench().hold())
    process.bench.follows = False
    while process.incident is None:
        process.bench.q[2] += 1e-3
        process.bench.tick()

    def note(line: str) -> None:
        tried.append(line)
        raise OSError(errno.ENOSPC, "No space left on device")

    def pretend(*given: Any, look: Look, **_: object) -> None:
        report, started = given[-2:]

        def look_and_end(*told: Any) -> None:
            look(*told)
            if tried and "are not saved" in tried[-1]:
                process.bench.mail.command.shutdown = 1

        monkeypatch.setattr(process, "report", report)
        started()
        _run_and_watch(process, look_and_end)  # type: ignore[arg-type]

    (tmp_path / "log").touch()  # no folder for incidents in here
    monkeypatch.setattr("qrobot.cli.servo.note", note)
    monkeypatch.setattr("qrobot.servo.process.daemon.serve", pretend)
    deployment = str(write_deployment(tmp_path))
    assert run_app(make_app("servo"), ["servo", deployment, "--own-guardian"]) == 0
    assert process.ended


def test_what_people_are_told_is_of_one_whole_cycle() -> None:
    """Mode, event and joint of a cycle that is still at work do not belong together yet."""
    process = Process(ServoBench().hold())
    herald = _Herald(process)  # type: ignore[arg-type]
    herald.announce(process.incident)
    process.said.clear()
    state = process.bench.state
    state.mode, state.event, state.event_joint = int(Mode.FAULT), int(FaultCode.FOLLOWING), 2
    herald.announce(process.incident)
    assert process.said == []


def test_a_stop_is_told_once_also_when_it_is_seen_before_its_cycle_is_published() -> None:
    process = Process(ServoBench().hold())
    herald = _Herald(process)  # type: ignore[arg-type]
    herald.announce(process.incident)
    process.said.clear()
    process.bench.follows = False
    published = view_words(process.mailbox.memory.published)
    before = published.copy()
    while process.incident is None:
        before = published.copy()
        process.bench.q[2] += 1e-3
        process.bench.tick()
    after = published.copy()
    published[:] = before
    herald.announce(process.incident)
    herald.announce(process.incident)
    published[:] = after
    herald.announce(process.incident)
    assert len(process.said) == 1
    assert "FOLLOWING" in process.said[0]


def test_no_change_while_the_arm_moves() -> None:
    process = Bench(ServoBench().hold())
    moving(process.bench)
    assert process.bench.mode is Mode.TRACKING
    ask = ChangeGains(kv=tuple(process.robot.control.kv))
    ticking = threading.Thread(target=process.bench.run, args=(0.3,))
    ticking.start()
    with pytest.raises(QRobotError, match="not in mode TRACKING"):
        Controls(process)._obey(ask)
    ticking.join()


def test_power_taken_away_by_another_stays_away_until_the_commander_asks_anew() -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_power_off()
    bench.run(0.1)
    assert bench.mode is Mode.OFF  # although `command.power` is still 1
    bench.run(1.0)
    assert bench.mode is Mode.OFF
    bench.mailbox.request_power(False)
    bench.tick()
    bench.hold()
    assert bench.mode is Mode.HOLDING


def test_taking_power_away_from_a_moving_arm_is_a_controlled_stop() -> None:
    bench = ServoBench().hold()
    moving(bench)
    bench.mailbox.request_power_off()
    bench.tick()
    assert bench.mode is Mode.STOPPING
    bench.run(1.0)
    assert bench.mode is Mode.OFF
    np.testing.assert_array_equal(bench.state.swap.gains[KP], bench.params.gains[KP])
    np.testing.assert_array_equal(bench.state.swap.gains[KV], bench.params.gains[KV])


def test_the_status_of_a_faulted_servo_tells_what_was_measured_and_what_was_allowed() -> None:
    bench = ServoBench().hold()
    bench.follows = False
    for _ in range(100):
        bench.q[2] += 1e-3
        bench.tick()
    status = Controls(Bench(bench)).status()
    assert (status.mode, status.fault) == ("FAULT", FaultCode.FOLLOWING)
    assert re.match(r"joint 3: 0\.\d+ rad, limit 0\.06 rad; FOLLOWING: a joint lags", status.text)


def test_the_status_of_a_held_arm_that_is_pushed_tells_no_other_joint_s_older_collision() -> None:
    bench = ServoBench().hold()
    state, code = bench.state, int(FaultCode.COLLISION)
    note_incident(state.watch.incident, 0, 0, code, 4, 7.1, 5.2, int(Mode.TRACKING), int(Mode.STOPPING), 9)
    for joint, text in ((4, "joint 5: 7.1 N m, limit 5.2 N m; COLLISION: "), (1, "joint 2: COLLISION: ")):
        report_event(state, code, joint)
        bench.tick()
        assert Controls(Bench(bench)).status().text.startswith(text)


@pytest.mark.parametrize("mistake", [ZeroDivisionError("ours"), SystemExit("ours")])
def test_a_mistake_of_ours_neither_ends_the_control_interface_nor_waits_for_a_terminal(mistake: BaseException) -> None:
    class Broken:
        served = 0

        def serve(self, _seconds: float) -> None:
            self.served += 1
            if self.served == 1:
                raise mistake

    broken: Any = Broken()
    with _served(broken) as problems:
        wait_until(lambda: broken.served > 2, "it goes on")
    (told,) = problems
    assert f"{type(mistake).__name__}: ours" in told


class Late:
    """Answers the first request only when there is a second one, which it refuses."""

    def __init__(self) -> None:
        self.first: OperatorConnection | None = None

    def answer(self, visitor: OperatorConnection, _line: bytes) -> bytes:
        if self.first is None:
            self.first = visitor
            return b""
        with contextlib.suppress(OSError):  # nobody listens there any more
            self.first.connection.sendall(encode(Reply(ok=True, fences=())))
        return encode(Reply(ok=False, error="refused"))


def test_the_late_answer_to_a_request_is_never_taken_for_that_to_the_next() -> None:
    arm, servo = f"t{uuid.uuid4().hex[:10]}", Late()
    with (
        ControlSocket(arm, servo.answer, lambda _: None) as control,
        _served(control),
        ServoClient(arm, 0.2) as client,
    ):
        with pytest.raises(LinkTimeout):
            client.fences()
        client._patience_s = PATIENCE_S
        with pytest.raises(QRobotError, match="refused"):
            client.fences()


def test_a_client_speaks_to_a_servo_that_is_there_again_also_when_it_looked_for_it_too_early() -> None:
    arm = f"t{uuid.uuid4().hex[:10]}"
    with ControlSocket(arm, lambda *_: b"", lambda _: None) as mute, _served(mute):
        client = ServoClient(arm, 0.2)
        with pytest.raises(LinkTimeout):
            client.fences()
    client._patience_s = PATIENCE_S
    for _ in range(2):
        with pytest.raises(LinkError, match=f"no servo of {arm} runs here"):
            client.fences()
    answer = encode(Reply(ok=True, fences=()))
    with ControlSocket(arm, lambda *_: answer, lambda _: None) as back, _served(back), client:
        assert client.fences() == ()


@pytest.mark.usefixtures("runtime_folder")
def test_a_servo_that_takes_no_connection_any_more_runs_and_is_said_not_to_answer() -> None:
    with contextlib.ExitStack() as stack:
        stack.enter_context(ControlSocket("hung", print, print))  # type: ignore[arg-type]
        for _ in range(MAX_CLIENTS + 1):  # as many as the kernel keeps for whoever listens
            stack.enter_context(ServoClient("hung"))
        with pytest.raises(LinkTimeout, match="the servo of hung does not answer: press the emergency stop if"):
            ServoClient("hung", timeout_s=0.01)
        front = stack.enter_context(create_servo_memory("hung", "puma560", "pd", 6, 1_000_000, 16)).front
        front.guardian.takeover = 1
        with pytest.raises(LinkTimeout, match="does not answer; its guardian has taken torque and power away"):
            ServoClient("hung", timeout_s=0.01)
        assert arms_that_run() == ["hung"]


@pytest.mark.usefixtures("runtime_folder")
def test_a_client_waits_while_a_servo_lets_in_those_who_came_before(monkeypatch: pytest.MonkeyPatch) -> None:
    with contextlib.ExitStack() as stack:
        control = stack.enter_context(ControlSocket("slow", lambda *_: b"", lambda _: None))
        for _ in range(MAX_CLIENTS + 1):
            stack.enter_context(ServoClient("slow"))
        monkeypatch.setattr(client_module, "sleep_between_looks", lambda _: control.serve(0.0))
        stack.enter_context(ServoClient("slow"))


def test_a_law_may_take_long_to_compile_and_what_is_obeyed_at_once_may_not(
    servo: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "AT_ONCE_S", 0.5 * client_module.TIMEOUT_S)
    with ServoClient(servo.arm) as client:
        patience: list[float | None] = []
        line = client._line
        monkeypatch.setattr(client, "_line", lambda: (patience.append(client._socket.gettimeout()), line())[1])
        client.change_law("pd")
        client.change_override(0.5)
        client.status()
    assert patience == [client_module.COMPILE_PATIENCE_S, client_module.TIMEOUT_S, client_module.AT_ONCE_S]


@pytest.mark.parametrize("ask", [ServoClient.stop, ServoClient.power_off, ServoClient.status, ServoClient.fences])
def test_a_servo_that_hangs_is_told_of_sooner_where_it_would_answer_at_once(
    ask: Callable[[ServoClient], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = f"t{uuid.uuid4().hex[:10]}"
    monkeypatch.setattr(client_module, "AT_ONCE_S", 0.01)
    silent, told = ControlSocket(arm, print, print), f"the servo of {arm} does not answer"  # type: ignore[arg-type]
    with silent, ServoClient(arm, 2.0 * PATIENCE_S) as client, pytest.raises(LinkTimeout, match=told):
        ask(client)


def test_whoever_breaks_off_a_request_may_stop_the_arm_by_the_same_client(
    servo: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ServoClient(servo.arm) as client:
        with monkeypatch.context() as patch:
            patch.setattr(client, "_line", lambda: signal.raise_signal(signal.SIGINT))
            with pytest.raises(KeyboardInterrupt):
                client.fences()
        stops = int(servo.bench.mail.command.stops)
        assert client.stop().mode == "OFF"
        assert servo.bench.mail.command.stops == stops + 1


@pytest.mark.parametrize("halt", ["request_stop", "request_power_off"])
def test_a_stop_or_a_power_off_takes_back_the_power_that_is_just_being_asked_for(
    servo: Bench, client: ServoClient, halt: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.power_off()
    wait, halts = Controls._wait_for_loop, [getattr(servo.mailbox, halt)]

    def wait_and_halt(controls: Controls) -> None:
        while halts:
            halts.pop()()
        wait(controls)

    monkeypatch.setattr(Controls, "_wait_for_loop", wait_and_halt)
    with pytest.raises(QRobotError, match="asked for a stop, or for no power"):
        client.power_on()
    assert client.status().mode == "OFF"
    assert servo.bench.mail.command.power == 0
    assert client.power_on().mode == "HOLDING"
    client.power_off()


def test_a_board_has_no_counter_for_a_seventh_joint() -> None:
    robot: Any = SimpleNamespace(name="seven", n=7)
    with (
        QueuedReport(print) as report,
        pytest.raises(ConfigError, match=r"seven has 7 joints, and a board 6 encoder channels: .* off line"),
    ):
        serve("nobody", robot, ServoSettings(), False, report, print)


def test_a_board_that_tells_of_too_few_encoder_channels_gets_no_servo() -> None:
    name = f"t{uuid.uuid4().hex[:10]}"
    with create_board_memory(name) as board:
        board.memory.facts.joints = 5
        with pytest.raises(ConfigError, match="puma560 has 6 joints, its board tells of 5 encoder channels"):
            serve(name, load_robot("puma560"), ServoSettings(), False, print, print)
        command_board_memory(name).close()  # nobody holds it


def test_a_second_servo_is_refused_where_the_files_of_the_first_have_been_removed() -> None:
    """As a logout may do: `qrobot ctl stop` would reach the second one, and succeed."""
    name = f"t{uuid.uuid4().hex[:10]}"
    with create_board_memory(name) as board, sole_servo(name):
        board.memory.facts.joints = 6
        with pytest.raises(LinkBusy, match=rf"process {os.getpid()} drives {name}: a servo whose files"):
            serve(name, load_robot("puma560"), ServoSettings(), False, print, print)
        with pytest.raises(LinkError):
            attach_servo_memory(name)


def test_resume_is_heard_as_the_end_of_a_pause_also_when_there_was_none(servo: Bench) -> None:
    """The servo sees to it, and to that a pause which somebody asks for stays: see test_override.py."""
    command = servo.bench.mail.command
    with ServoClient(servo.arm) as client, ServoClient(servo.arm) as other:
        before = int(command.resumes)
        assert not client.resume().paused
        assert command.resumes == before + 1
        other.pause()
        assert not client.resume().paused
        assert command.resumes == before + 1  # it was the end of a pause


def test_status_tells_that_a_program_waits_to_go_back_to_its_path_until_it_is_silent(
    servo: Bench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ctl, "choose_arm", lambda *_: SimpleNamespace(name=servo.arm))
    monkeypatch.setattr(ctl, "robot_of_servo", lambda *_: servo.robot)
    said_ns, late_ns = 5_000_000_000, 6_000_000_000
    servo.mailbox.tell_path_waits(said_ns)
    assert servo.mailbox.path_waits(said_ns + 100_000_000)
    assert not servo.mailbox.path_waits(late_ns)
    servo.mailbox.tell_path_waits(0)
    assert not servo.mailbox.path_waits(100_000_000)
    for waits in (True, False):
        monkeypatch.setattr(ServoMailbox, "path_waits", lambda _self, _now_ns, waits=waits: waits)
        with ServoClient(servo.arm) as client:
            assert client.status().path_waits is waits
        ctl.status()
        assert ("then `qrobot ctl resume`" in " ".join(capsys.readouterr().out.split())) is waits
