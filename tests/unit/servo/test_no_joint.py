"""One value says that a code speaks of no joint, wherever codes are kept, sent and told."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields, replace

import numpy as np
import pytest

from qrobot.faultcodes import NO_JOINT, FaultCode, explain
from qrobot.modecodes import Mode
from qrobot.rccl_bridge.mailbox_port import MailboxPort
from qrobot.rci.power import servo_fault
from qrobot.servo.event import report_event, report_fault
from qrobot.servo.memory.stop_record import INCIDENT_WORDS, Incident, note_incident, read_incident
from qrobot.servo.operator.requests import Controls
from qrobot.servo.state import ServoState
from qrobot.wire import State
from qrobot.wire.codec import decode, encode
from tests.support.packets import resting
from tests.support.servo_bench import ServoBench, moving
from tests.unit.servo.test_control import Bench

CODES = [code for code in FaultCode if code]
JOINTS = (NO_JOINT, 0, 5)
NUMBERS = [field.name for field in fields(ServoState) if field.default is not MISSING]
NAMED = re.compile(r"\bjoint (\d+)\b")


@pytest.fixture(scope="module")
def at_rest() -> tuple[ServoBench, dict[str, float]]:
    """A servo at rest, and the numbers of its state by which it is at rest again."""
    bench = ServoBench().tick(3)
    return bench, {name: getattr(bench.state, name) for name in NUMBERS}


def named_in(text: str) -> int:
    """The joint a line for people begins with, from 0; `NO_JOINT` when it begins with none."""
    found = re.match(r"joint (\d+): ", text)
    return int(found[1]) - 1 if found else NO_JOINT


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("code", CODES)
def test_every_text_of_a_code_names_its_joint_and_no_other(code: FaultCode, joint: int) -> None:
    told = Incident(1, 0, 0, code, joint, 2.0, 1.0, Mode.TRACKING, Mode.FAULT, 0)
    robot = replace(resting((0.0,) * 6), mode=Mode.FAULT, fault=code, event=code, event_joint=joint)
    fault = str(servo_fault(robot, "no arm power")).removeprefix("no arm power: ")
    for text in (explain(code, joint), told.why([]), replace(told, value=0.0, limit=0.0).why([]), fault):
        assert named_in(text) == joint
        assert NAMED.findall(text) == ([str(joint + 1)] if joint != NO_JOINT else [])


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("code", CODES)
def test_every_code_goes_from_the_cycle_to_the_wire_with_its_joint(
    at_rest: tuple[ServoBench, dict[str, float]], code: FaultCode, joint: int
) -> None:
    bench, numbers = at_rest
    for name, value in numbers.items():
        setattr(bench.state, name, value)
    report_event(bench.state, code, joint)
    bench.tick()
    assert (bench.snapshot.event, bench.snapshot.event_joint) == (code, joint)
    heard = decode(encode(State(1, MailboxPort(bench.mailbox.words).read_state())))
    assert isinstance(heard, State)
    assert (heard.robot.event, heard.robot.event_joint) == (code, joint)


def test_the_joint_of_an_earlier_event_does_not_stay_with_a_later_one() -> None:
    bench = ServoBench()
    moving(bench, joint=3)
    report_fault(bench.state, FaultCode.FOLLOWING, 3, 0.2, 0.1)
    bench.tick()
    assert (bench.event, bench.snapshot.event_joint) == (FaultCode.FOLLOWING, 3)
    bench.estop_ok = False
    bench.mailbox.request_clear()
    bench.until(lambda: bench.event is not FaultCode.FOLLOWING)
    assert (bench.event, bench.snapshot.event_joint) == (FaultCode.RESET_DENIED, NO_JOINT)
    bench.estop_ok = True
    bench.mailbox.request_clear()
    bench.until(lambda: bench.mode is Mode.OFF)
    assert (bench.event, bench.snapshot.event_joint) == (FaultCode.NONE, NO_JOINT)


def test_an_emergency_stop_is_about_no_joint_and_a_servo_begins_with_none() -> None:
    bench = ServoBench().tick()
    assert bench.snapshot.event_joint == NO_JOINT
    bench.hold()
    bench.estop_ok = False
    bench.tick()
    told = read_incident(bench.state.watch.incident)
    assert told is not None
    assert (told.code, told.joint, bench.snapshot.event_joint) == (FaultCode.ESTOP, NO_JOINT, NO_JOINT)
    assert told.why([]) == explain(FaultCode.ESTOP)


def test_the_status_of_a_servo_in_an_emergency_stop_names_no_joint() -> None:
    bench = ServoBench().hold()
    bench.estop_ok = False
    bench.tick(2)
    status = Controls(Bench(bench)).status()
    assert (status.fault, status.event_joint) == (FaultCode.ESTOP, NO_JOINT)
    assert status.text == explain(FaultCode.ESTOP)


def test_the_first_joint_is_named_like_any_other() -> None:
    record = np.zeros(INCIDENT_WORDS, dtype=np.int64)
    note_incident(record, 0, 0, FaultCode.ENC_JUMP, 0, 0.0, 0.0, Mode.HOLDING, Mode.FAULT, 0)
    told = read_incident(record)
    assert told is not None
    assert told.line([]).startswith("HOLDING -> FAULT: joint 1: ENC_JUMP")


@pytest.mark.parametrize("spoilt", [-2, 6, 65535, -(2**62), 2**62])
def test_a_spoilt_joint_in_shared_memory_reaches_no_client(spoilt: int) -> None:
    bench = ServoBench().tick()
    bench.mail.published.state.event_joint = spoilt
    assert MailboxPort(bench.mailbox.words).read_state().event_joint == NO_JOINT
