"""Pages at the pendant: who may do what, and what is told. No browser, no process, no socket."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.config.deployment import load_deployment
from qrobot.config.start_place import start_text
from qrobot.errors import MotionError, RemoteProtocolError
from qrobot.model.arm import Arm
from qrobot.pendant.arm_station import ArmStation, close_all
from qrobot.pendant.floor import DriveFloor
from qrobot.pendant.frames import HEAD, STATE_FRAME
from qrobot.pendant.lease import ANSWER_S, SILENCE_S
from qrobot.pendant.messages import decode_message
from qrobot.pendant.program_messages import PageProgramStart
from qrobot.transform_file import TransformFile
from qrobot.wire import RobotState, State
from tests.support.puma import ROBOT

PRESS = {"do": "press", "arm": 0, "number": 1, "target": "joint", "name": "2", "way": -1, "share": 0.5}
Q = tuple(ROBOT.poses["end"].tolist())


class Floor(DriveFloor):
    """Arms whose processes and servos are only written down; those of the second one by its number."""

    def __init__(self, folder: Path, arms: int = 1) -> None:
        super().__init__(lambda: self.now_s)
        self.now_s = 0.0
        self.asked: list[Any] = []
        for number in range(arms):
            self.arms.append(self.make_station(folder, number))
        self.station = self.arms[0]
        self.pages = [self.enter(lambda: None), self.enter(lambda: None)]

    def make_station(self, folder: Path, number: int) -> ArmStation:
        arm = load_deployment("emulator").arm[0]
        arm = arm.model_copy(update={"bridge": arm.bridge.model_copy(update={"port": arm.bridge.port + number})})
        tell = lambda state: self.sampled(number, state)  # noqa: E731
        ask = lambda what: self.asked.append((number, what) if number else what)  # noqa: E731
        place, clock = folder / "t.db", lambda: self.now_s
        station = ArmStation(arm, ROBOT, (0.0, 0.0, 0.0), place, tell, self.changed, clock=clock)
        station.worker.say = lambda **message: ask(message)  # type: ignore[method-assign]
        station.worker.start = lambda: None  # type: ignore[method-assign]
        station.requests.stop = lambda *_: ask("stop")  # type: ignore[method-assign]
        station.requests.act = ask  # type: ignore[method-assign]
        station.requests.power_off = lambda _: ask("power off")  # type: ignore[method-assign]
        station.places._changes.submit = lambda change, *how: change(*how)  # type: ignore[method-assign, assignment]
        station.watch.problem = ""
        return station

    def says(self, page: int, **message: Any) -> list[Any]:
        """What is asked for when a page (from 0) says this."""
        del self.asked[:]
        self.obey(self.pages[page], decode_message(json.dumps(message)))
        return list(self.asked)


@pytest.fixture
def floor(tmp_path: Path) -> Floor:
    return Floor(tmp_path)


def test_only_the_page_that_drives_moves_the_arm_and_everybody_may_stop_it(floor: Floor) -> None:
    assert floor.says(0, **PRESS) == []
    told = [json.loads(floor.status(page)) for page in floor.pages]
    assert "Drive from here" in told[0]["notice"]  # the page that asked, and no other
    assert [each["notices"] for each in told] == [1, 0]
    assert floor.station.status["notices"] == 0
    floor.says(0, do="take", arm=0)
    floor.says(1, do="take", arm=0)
    assert json.loads(floor.status(floor.pages[1]))["arms"][0]["driver"] == 1
    pressed = floor.says(0, **PRESS)
    assert pressed[0] == {"do": "release"}
    more = {"in_base": True, "step": 0.0, "frame": ""}
    assert pressed[1] == {key: value for key, value in PRESS.items() if key != "arm"} | more
    assert floor.says(0, do="beat", arm=0, number=1) == [{"do": "beat", "number": 1}]
    acts = [{"do": "act", "arm": 0, "name": name} for name in ("power on", "clear", "resume")]
    others = [{"do": "beat", "arm": 0, "number": 1}, {"do": "release"}, {"do": "command", "arm": 0, "on": True}]
    for message in (PRESS, *acts, *others):
        assert floor.says(1, **message) == []
    assert floor.says(1, do="stop") == ["stop", {"do": "stop"}]
    taken_back = {"do": "stop", "power_off": True}  # an arm that is about to be taken would be powered afterwards
    assert floor.says(1, do="act", arm=0, name="power off") == ["power off", taken_back]
    assert floor.says(1, do="act", arm=0, name="pause") == ["pause"]
    with pytest.raises(MotionError, match="none of number 2"):
        floor.says(0, **PRESS | {"arm": 1})


def test_a_page_that_goes_or_sleeps_lets_go_of_the_arm_and_another_one_may_drive(floor: Floor) -> None:
    given = [{"do": "release"}, {"do": "off"}]
    floor.says(0, do="take", arm=0)
    del floor.asked[:]
    floor.leave(floor.pages[0])
    assert floor.asked == given
    floor.says(1, do="take", arm=0)
    floor.now_s = SILENCE_S
    floor.says(1, do="alive")
    floor.now_s += SILENCE_S
    floor.look_at_lease()
    assert floor.asked == []
    floor.now_s += 0.1
    floor.look_at_lease()
    assert floor.asked == given
    assert json.loads(floor.status(floor.pages[1]))["arms"][0]["driver"] is None


def test_a_page_asks_the_one_that_drives_which_is_told_and_keeps_the_arm_gives_it_up_or_lets_it_go(
    floor: Floor,
) -> None:
    first, second = floor.pages
    given = [{"do": "release"}, {"do": "off"}]
    floor.says(0, do="take", arm=0)
    assert floor.says(1, do="take", arm=0) == []
    assert "page 2 asks to drive" in json.loads(floor.status(first))["notice"]
    assert json.loads(floor.status(first))["arms"][0] | {"driver": 1, "asker": 2} == floor.station.status
    assert floor.says(1, **PRESS) == []
    floor.says(0, do="beat", arm=0, number=1)
    assert "page 1 keeps driving" in json.loads(floor.status(second))["notice"]
    assert floor.station.lease.asker is None
    floor.says(1, do="take", arm=0)
    assert floor.says(0, do="take", arm=0) == []  # Keep driving
    assert [floor.station.lease.holder, floor.station.lease.asker] == [1, None]
    floor.says(1, do="take", arm=0)
    assert floor.says(0, do="give", arm=0) == given
    assert floor.station.lease.holder == 2
    floor.says(0, do="take", arm=0)
    for _ in range(int(ANSWER_S) + 1):
        del floor.asked[:]
        floor.now_s += 1.0
        floor.says(1, do="alive")
        floor.look_at_lease()
    assert floor.station.lease.holder == 1
    assert floor.asked == given
    assert "page 2 did not answer: page 1 drives" in floor.station.status["notice"]


def test_load_collisions_and_the_way_back_are_chosen_by_the_page_that_drives_alone(floor: Floor) -> None:
    requests, asked = floor.station.requests, floor.asked
    requests.load = lambda *told: asked.append(told)  # type: ignore[method-assign]
    requests.collision = lambda *told: asked.append(told)  # type: ignore[method-assign]
    load = {"do": "load", "arm": 0, "mass": 1.5, "centre_mm": [0, 10, 50]}
    collision = {"do": "collision", "arm": 0, "share": 0.5, "reaction": "comply"}
    assert floor.says(0, **load) == floor.says(0, **collision) == []
    floor.says(0, do="take", arm=0)
    ((mass, centre_m),) = floor.says(0, **load)
    assert (mass, centre_m) == (1.5, pytest.approx([0.0, 0.01, 0.05]))
    floor.station.worker.session = "ready"  # the pendant itself commands the arm, and so it tells the load
    assert floor.says(0, **load) == [{"do": "load", "mass": 1.5, "centre": [0.0, 10.0, 50.0]}]
    floor.station.worker.session = "no"
    ((thresholds, reaction),) = floor.says(0, **collision)
    assert thresholds == pytest.approx((0.5 * ROBOT.guard.unexplained_torque_or_default).tolist())
    assert reaction == "comply"
    assert floor.says(0, **collision | {"share": 1.0})[0][0] == ()  # those of the robot file
    told = floor.says(0, do="command", arm=0, on=True, back_mm=20)
    assert told == [{"do": "on", "guide": False, "back": 20.0}]
    bad = (
        load | {"mass": -1},
        load | {"centre_mm": [0, 0]},
        collision | {"share": 2},
        collision | {"reaction": "retract"},
    )
    for message in (*bad, {"do": "command", "arm": 0, "on": True, "back_mm": 301}):
        with pytest.raises(RemoteProtocolError):
            decode_message(json.dumps(message))


def test_each_of_two_arms_is_driven_by_the_page_that_has_its_lease_and_stop_stops_both(tmp_path: Path) -> None:
    floor = Floor(tmp_path, arms=2)
    other = PRESS | {"arm": 1, "number": 7}
    for page, arm in ((0, 0), (1, 1), (1, 0)):  # the last one in vain
        floor.says(page, do="take", arm=arm)
    assert [arm["driver"] for arm in json.loads(floor.status(floor.pages[0]))["arms"]] == [1, 2]
    assert floor.says(0, **PRESS)[1]["number"] == 1
    assert [number for number, _ in floor.says(1, **other)] == [1, 1]  # what the first page holds at its arm goes on
    assert floor.says(0, **other) == floor.says(1, **PRESS) == floor.says(1, do="command", arm=0, on=True) == []
    assert floor.says(1, do="release") == [(1, {"do": "release"})]
    stop = ["stop", {"do": "stop"}]
    assert floor.says(0, do="stop") == [*stop, *((1, each) for each in stop)]
    given = [{"do": "release"}, {"do": "off"}]
    assert floor.says(1, do="give", arm=0) == []
    assert floor.says(1, do="give", arm=1) == [(1, each) for each in given]
    floor.says(0, do="take", arm=1)
    floor.leave(floor.pages[0])
    assert floor.asked == [*given, *((1, each) for each in given)]
    assert [arm.lease.holder for arm in floor.arms] == [None, None]


def test_a_page_of_two_arms_lets_go_of_one_before_it_moves_the_other(tmp_path: Path) -> None:
    floor = Floor(tmp_path, arms=2)
    for arm in (0, 1):
        floor.says(0, do="take", arm=arm)
    floor.says(0, **PRESS)
    told = floor.says(0, **PRESS | {"arm": 1, "number": 2})
    assert told[:2] == [{"do": "release"}, (1, {"do": "release"})]
    assert told[2][1]["do"] == "press"


def test_a_sample_reaches_every_page_as_it_is_and_where_the_arm_is_can_be_recorded(
    floor: Floor, tmp_path: Path
) -> None:
    v, tau, setpoint = (0.1,) * 6, (2.0,) * 6, tuple(np.array(Q) + 0.001)
    robot = RobotState(t_ns=2_500_000_000, mode=5, fault=66, event=28, event_joint=-1, hand=1, flags=0x207, q=Q, v=v,
                       tau=tau, q_setpoint=setpoint, override=0.35)  # fmt: skip
    floor.station.watch._tell(State(1, robot, commanded=True))
    frame = floor.pages[0].frames[-1]
    assert floor.pages[1].frames[-1] == frame
    assert HEAD.unpack_from(frame) == (STATE_FRAME, 0, 5, 1, 66, 28, -1, 350, 0x207, 2.5)
    told = struct.unpack_from("<24f", frame, HEAD.size)
    assert told == pytest.approx([*Q, *setpoint, *v, *tau], abs=1e-6)
    floor.says(0, do="take", arm=0)
    floor.says(0, do="record", arm=0, name="HERE")
    assert TransformFile(tmp_path / "t.db").values()["HERE"] == pytest.approx(Arm(ROBOT).forward(np.array(Q)), abs=1e-6)
    assert floor.station.status["places"][-1] == "HERE"
    floor.says(0, do="record", arm=0, name="two words")
    assert floor.station.status["notice"].startswith("not recorded")


def test_what_a_page_is_told_first_has_every_arm_with_its_limits_and_every_code_with_its_remedy(floor: Floor) -> None:
    hello = json.loads(floor.hello(floor.pages[0]))
    (arm,) = hello["arms"]
    assert (arm["joints"], arm["q_max"]) == (list(ROBOT.joint_names), ROBOT.limits.q_max.tolist())
    assert hello["codes"]["66"][0] == "FOLLOWING"
    assert hello["modes"]["7"] == "FAULT"


START = {"do": "program start", "arm": 0, "name": "a.py", "manner": "live", "confirmed": True, "heard_s": 0.0}
READY = {"t_ns": 0, "mode": 5, "q": Q, "v": (0.0,) * 6, "tau": (0.0,) * 6, "q_setpoint": Q, "flags": 7}


def test_a_program_moves_the_arm_when_the_page_that_drives_has_confirmed_it_and_the_arm_is_ready(
    floor: Floor, monkeypatch: pytest.MonkeyPatch
) -> None:
    places: list[str] = []

    def start(request: PageProgramStart, _bridges: object, place: str) -> None:
        floor.asked.append(request.manner)
        places.append(place)

    monkeypatch.setattr(floor.station.programs, "start", start)
    assert floor.says(0, **START) == []
    floor.says(0, do="take", arm=0)
    refusals = [
        ({}, {"confirmed": False}, "confirm"),
        ({"flags": 6}, {}, "power on first"),
        ({"flags": 5}, {}, "not calibrated"),
        ({"flags": 3}, {}, "emergency stop"),
        ({"fault": 66}, {}, "clear the fault"),
    ]
    with pytest.raises(MotionError, match="nothing is known"):
        floor.says(0, **START)
    for state, message, why in refusals:
        floor.station.watch._tell(State(1, RobotState(**READY | state)))  # type: ignore[arg-type]
        with pytest.raises(MotionError, match=why):
            floor.says(0, **START | message)
    floor.station.watch._tell(State(1, RobotState(**READY), commanded=True))  # type: ignore[arg-type]
    with pytest.raises(MotionError, match="somebody else commands"):
        floor.says(0, **START)
    assert floor.says(0, **START | {"manner": "offline", "confirmed": False}) == ["offline"]
    assert places == [start_text(np.array(READY["q"]), ROBOT)]  # where the arm stands
    floor.station.watch._tell(State(1, RobotState(**READY)))  # type: ignore[arg-type]
    floor.station.worker.session = "ready"
    with pytest.raises(MotionError, match="let go of the arm"):
        floor.says(0, **START)
    floor.station.worker.session = "no"
    assert floor.says(0, **START) == ["live"]
    monkeypatch.setattr(floor.station.procedures, "start", lambda request: floor.asked.append(request.step))
    calibrate: dict[str, Any] = {"do": "procedure start", "arm": 0, "step": "calibrate", "heard_s": 0.0}
    floor.station.watch._tell(State(1, RobotState(**READY | {"flags": 4})))  # type: ignore[arg-type]
    with pytest.raises(MotionError, match="confirm"):
        floor.says(0, **calibrate)
    assert floor.says(0, **calibrate, confirmed=True) == ["calibrate"]
    with pytest.raises(MotionError, match="not calibrated"):
        floor.says(0, **calibrate | {"step": "record live"}, confirmed=True)
    assert floor.says(0, **calibrate | {"step": "record lockstep"}) == ["record lockstep"]
    assert floor.says(1, **calibrate, confirmed=True) == []


def test_a_program_reaches_the_arms_that_its_page_drives_and_none_of_another_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor = Floor(tmp_path, arms=2)
    for arm in floor.arms:
        monkeypatch.setattr(arm.programs, "start", lambda _, bridges, _place: floor.asked.append(bridges))
        arm.watch._tell(State(1, RobotState(**READY)))  # type: ignore[arg-type]
    own, other = (arm.bridge for arm in floor.arms)
    assert own != other
    floor.says(0, do="take", arm=0)
    assert floor.says(0, **START) == [[own]]  # that nobody drives the other one is no leave to move it
    floor.says(1, do="take", arm=1)
    assert floor.says(0, **START) == [[own]]
    assert floor.says(0, **START | {"arm": 1}) == []
    floor.says(1, do="give", arm=1)
    floor.says(0, do="take", arm=1)
    assert floor.says(0, **START | {"arm": 1}) == [[other, own]]


def test_a_program_that_moves_the_arm_is_ended_by_stop_of_any_page_and_paused_when_no_page_drives(
    floor: Floor, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs = floor.station.programs
    monkeypatch.setattr(type(programs), "live", True)
    monkeypatch.setattr(programs, "end", lambda: floor.asked.append("end"))
    monkeypatch.setattr(programs, "say", floor.asked.append)
    assert floor.says(1, do="stop") == ["stop", {"do": "stop"}, "end"]
    assert floor.says(1, do="program end", arm=0) == ["end"]
    assert floor.says(1, do="program say", arm=0, line="NEXT") == []
    floor.says(0, do="take", arm=0)
    assert floor.says(0, do="program say", arm=0, line="NEXT") == ["NEXT"]
    del floor.asked[:]
    floor.leave(floor.pages[0])
    assert floor.asked == [{"do": "release"}, {"do": "off"}, "pause"]
    assert "the program is paused" in floor.station.status["notice"]


def test_power_off_ends_what_is_about_to_power_the_arm_and_lets_a_program_that_commands_it_hear_of_it(
    floor: Floor, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("programs", "procedures"):
        runner = getattr(floor.station, name)
        monkeypatch.setattr(runner, "end", lambda name=name: floor.asked.append(name))
    monkeypatch.setattr(type(floor.station.programs), "live", True)
    off = ["power off", {"do": "stop", "power_off": True}]
    floor.station.watch._tell(State(1, RobotState(**READY), commanded=True))  # type: ignore[arg-type]
    assert floor.says(1, do="act", arm=0, name="power off") == off  # one that keeps its path waits on it
    floor.station.watch._tell(State(1, RobotState(**READY)))  # type: ignore[arg-type]
    assert floor.says(1, do="act", arm=0, name="power off") == [*off, "programs"]
    monkeypatch.setattr(type(floor.station.procedures), "live", True)
    assert floor.says(1, do="act", arm=0, name="power off") == [*off, "procedures", "programs"]


def test_a_program_of_two_arms_is_paused_at_both_when_either_of_them_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor = Floor(tmp_path, arms=2)
    paused = ["pause", (1, "pause")]
    pauses = lambda asked: [each for each in asked if each in paused]  # noqa: E731
    for arm in floor.arms:
        monkeypatch.setattr(arm.programs, "start", lambda *_: None)
        arm.watch._tell(State(1, RobotState(**READY)))  # type: ignore[arg-type]
    moving = floor.arms[1].programs

    def take_both() -> None:
        for arm in (0, 1):
            floor.says(0, do="take", arm=arm)

    take_both()
    floor.says(0, **START | {"arm": 1})
    monkeypatch.setattr(type(moving), "live", property(lambda programs: programs is moving))
    assert pauses(floor.says(0, do="give", arm=0)) == paused[::-1]  # the arm of the program, and what it reaches
    assert "no page drives" in floor.arms[1].status["notice"]
    take_both()
    assert pauses(floor.says(0, do="give", arm=1)) == paused[::-1]
    take_both()
    floor.says(0, do="give", arm=0)
    monkeypatch.setattr(type(moving), "live", False)
    floor.says(0, **START | {"arm": 1})
    monkeypatch.setattr(type(moving), "live", property(lambda programs: programs is moving))
    floor.says(0, do="take", arm=0)
    assert pauses(floor.says(0, do="give", arm=0)) == []  # it does not reach that one


def test_a_lease_that_has_run_out_is_taken_from_an_arm_that_is_let_go(
    floor: Floor, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also when the other page asks for it before the next look at it."""
    given = [{"do": "release"}, {"do": "off"}]
    floor.says(0, do="take", arm=0)
    floor.now_s += SILENCE_S + 0.1
    assert floor.says(1, do="take", arm=0) == given
    assert floor.station.lease.holder == 2
    monkeypatch.setattr(type(floor.station.programs), "live", True)
    floor.now_s += SILENCE_S + 0.1
    assert floor.says(0, do="take", arm=0) == [*given, "pause"]
    assert floor.station.lease.holder == 1
    floor.now_s += SILENCE_S + 0.1
    assert floor.says(0, do="take", arm=0) == []  # its own, which it keeps


def test_at_the_end_of_the_pendant_each_program_is_ended_before_it_waits_for_any(tmp_path: Path) -> None:
    floor, asked = Floor(tmp_path, arms=2), []

    class Run:
        state = "running"
        end = staticmethod(lambda: asked.append("end"))
        wait = staticmethod(lambda _seconds: asked.append("wait"))

    for arm in floor.arms:
        arm.programs._run = arm.procedures._run = Run()  # type: ignore[assignment]
    close_all(floor.arms)
    ends = 2 * len(floor.arms)
    assert asked[:ends] == ["end"] * ends
    assert asked.count("wait") == ends


def test_places_are_edited_by_their_numbers_renamed_and_struck_out(
    floor: Floor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = {"do": "place", "arm": 0, "name": "A", "numbers": [500, 0, 300, 0, 180, 45]}
    floor.says(0, do="take", arm=0)
    floor.says(0, **place)
    assert floor.station.status["taught"] == {"A": pytest.approx([500, 0, 300, 180, 0, -135])}  # the same orientation
    file = TransformFile(tmp_path / "t.db")
    assert file.values()["A"][:3, 3] == pytest.approx([0.5, 0, 0.3])
    floor.says(0, **place | {"name": "B", "instead": "A"})
    assert file.names() == ["B"]
    for refused in ({"name": "B"}, {"name": "park"}, {"name": "C", "instead": "A"}, {"name": "a b", "instead": "B"}):
        floor.says(0, **place | refused)
        assert floor.station.status["notice"].startswith("not recorded"), refused
    floor.says(1, do="remove", arm=0, name="B")
    assert file.names() == ["B"]
    floor.says(0, do="remove", arm=0, name="B")
    assert file.names() == []
    file.write("D", np.eye(4))  # by `qrobot teach`, say
    assert list(floor.station.status["taught"]) == ["D"]
    monkeypatch.setattr(TransformFile, "values", pytest.fail)
    assert list(floor.station.status["taught"]) == ["D"]  # not read again
    for numbers in ([1, 2, 3], [1, 2, 3, 4, 5, float("nan")], [1, 2, 3, 4, 5, 1e9]):
        with pytest.raises(RemoteProtocolError):
            decode_message(json.dumps(place | {"numbers": numbers}))
