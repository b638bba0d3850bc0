"""An arm that the pendant moves, on virtual time: an ideal arm, and presses at given instants."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qrobot.config.fences import Fence
from qrobot.errors import LinkLost
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.in_force import use_fences
from qrobot.model.arm import Arm
from qrobot.model.transform import rpy, transform
from qrobot.pendant.held_press import BEAT_S, PATIENCE_S, Press
from qrobot.pendant.jog_session import PERIOD_MS, JogSession
from qrobot.rccl.channel import Channel
from qrobot.rccl.held_motion import BRAKE_MS, JOINT_RAD_S, MARGIN
from qrobot.rccl.offline import OfflineLink
from qrobot.servo.speed_share import speed_share
from qrobot.transform_file import TransformFile
from qrobot.wire import Command, Hello, RobotFlag, State
from tests.support.puma import PARK, ROBOT

Deed = tuple[float, Callable[[JogSession], object]]
Operator = Callable[[float], float]  # the override at a time, s; 0 for a pause
Limits = tuple[float, float]  # share of the joints' greatest speeds, and speed of the tool, m/s


class Desk:
    """A page whose deeds are done when their time has come; the link keeps every sample."""

    def __init__(
        self, taught: Path, *deeds: Deed, operator: Operator = lambda _: 1.0, limits: Limits = (1.0, 0.0)
    ) -> None:
        self.operator, self.limits = operator, limits
        self.states: list[State] = []
        self.held: list[bool] = []
        self.said: list[str] = []
        self._deeds = sorted(deeds, key=lambda deed: deed[0])
        self._link: OfflineLink | None = None
        self.session = JogSession("puma560", self._open, taught, lambda: None, self.said.append, self.now_s)
        self.session.run()

    def _open(self, hello: Hello) -> OfflineLink:
        self._link = _Watched(hello, self)
        return self._link

    def now_s(self) -> float:
        return 0.0 if self._link is None else self._link.now_ns() * 1e-9

    def pass_time(self, command: Command | None, state: State) -> None:
        self.states.append(state)
        self.held.append(command is not None and command.key_held)
        while self._deeds and self._deeds[0][0] <= self.now_s():
            self._deeds.pop(0)[1](self.session)

    @property
    def q(self) -> np.ndarray:
        return np.array([state.robot.q for state in self.states])

    def at(self, seconds: float) -> np.ndarray:
        return np.asarray(self.q[round(seconds / (PERIOD_MS * 1e-3))])


class _Watched(OfflineLink):
    def __init__(self, hello: Hello, desk: Desk) -> None:
        super().__init__(hello)
        self._desk = desk

    def exchange(self, command: Command | None) -> State:
        state = super().exchange(command)
        factor = self._desk.operator(self._desk.now_s())
        limit, tool = self._desk.limits
        flags = state.robot.flags | (RobotFlag.PAUSED if not factor else 0)
        state = replace(
            state,
            robot=replace(state.robot, override=factor or 1.0, flags=flags, speed_limit=limit, tool_speed_limit=tool),
        )
        self._desk.pass_time(command, state)
        return state


def hold(press: Press, begin_s: float, end_s: float, silent: tuple[float, float] = (0.0, 0.0)) -> list[Deed]:
    """A button that is held, by a page that says nothing in between."""
    beats = np.arange(begin_s + BEAT_S, end_s, BEAT_S).tolist()
    told = [t for t in beats if not silent[0] <= t < silent[1]]
    deeds: list[Deed] = [(begin_s, lambda session: session.press.begin(press, begin_s))]
    return [*deeds, *((t, lambda session, t=t: session.press.beat(press.number, t)) for t in told),
            (end_s, lambda session: session.press.end())]  # fmt: skip


def leave(seconds: float) -> Deed:
    return (seconds, lambda session: session.leave())


TURN = Press(1, "joint", "1", 1.0, share=2.0)


def test_a_joint_turns_while_its_button_is_held_and_nothing_else_does(tmp_path: Path) -> None:
    desk = Desk(tmp_path / "t.db", *hold(TURN, 1.0, 2.5), leave(4.0))
    moved = desk.at(3.9) - desk.at(0.9)
    assert 2.0 * JOINT_RAD_S * 1.2 < moved[0] < 2.0 * JOINT_RAD_S * (1.5 + BRAKE_MS * 1e-3)
    assert np.abs(moved[1:]).max() < 1e-9
    assert desk.at(3.9) == pytest.approx(desk.at(2.5 + BRAKE_MS * 1e-3), abs=1e-9)
    assert desk.said == []


def test_a_page_that_stalls_and_comes_back_with_its_button_down_moves_nothing_until_it_is_pressed_anew(
    tmp_path: Path,
) -> None:
    again = Press(2, "joint", "1", 1.0, share=2.0)
    stalled = hold(TURN, 1.0, 5.0, silent=(2.0, 3.5))
    desk = Desk(tmp_path / "t.db", *stalled, *hold(again, 6.0, 7.0), leave(8.5))
    rest_s = 2.0 + PATIENCE_S + BRAKE_MS * 1e-3
    assert desk.at(rest_s)[0] > desk.at(1.0)[0] + 0.1
    assert desk.at(5.9) == pytest.approx(desk.at(rest_s), abs=1e-9)
    assert not any(desk.held[round(rest_s / 0.028) + 1 : round(5.9 / 0.028)])  # the servo was told so too
    assert desk.at(8.4)[0] > desk.at(5.9)[0] + 0.1
    (told,) = desk.said
    silence_s = float(told.partition(" for ")[2].partition(" s;")[0])
    assert PATIENCE_S < silence_s <= PATIENCE_S + PERIOD_MS * 1e-3 + 5e-4  # found at the next sample, told in ms


def test_steps_end_by_themselves_straight_inside_the_range_and_along_the_axes_of_a_taught_place(tmp_path: Path) -> None:
    low = ROBOT.limits.q_max[4]
    taught = tmp_path / "t.db"
    table = transform(rpy(0.4, -0.3, 0.2), (0.5, 0.1, -0.2))
    TransformFile(taught).write("TABLE", table)
    desk = Desk(
        taught,
        *hold(Press(1, "joint", "2", -1.0, step=0.02), 1.0, 4.0),
        *hold(Press(2, "axis", "dz", 1.0, in_base=True, step=10.0), 5.0, 9.0),
        *hold(Press(3, "axis", "dy", -1.0, step=10.0, frame="TABLE"), 10.0, 14.0),
        *hold(Press(4, "axis", "dy", -1.0, frame="CHAIR"), 14.5, 15.0),
        *hold(Press(5, "joint", "5", 1.0, share=4.0, step=50.0), 15.5, 21.5),
        leave(22.5),
    )
    arm = Arm(ROBOT)
    assert desk.at(4.5)[1] - desk.at(0.9)[1] == pytest.approx(-0.02, abs=1e-6)
    risen = arm.forward(desk.at(9.5))[:3, 3] - arm.forward(desk.at(4.5))[:3, 3]
    assert risen == pytest.approx([0.0, 0.0, 0.010], abs=1e-5)
    gone = arm.forward(desk.at(14.4))[:3, 3] - arm.forward(desk.at(9.5))[:3, 3]
    assert gone == pytest.approx(-0.010 * table[:3, 1], abs=1e-5)
    assert ["no transform 'CHAIR'" in desk.said[0], len(desk.said)] == [True, 1]
    assert desk.at(22.4)[4] == pytest.approx(low - MARGIN, abs=1e-6)


def test_a_place_is_gone_to_and_what_cannot_be_done_is_told_and_ends_nothing(tmp_path: Path) -> None:
    taught = tmp_path / "t.db"
    pose = Arm(ROBOT).forward(ROBOT.poses["park"])
    pose[2, 3] += 0.02
    TransformFile(taught).write("ABOVE", pose)
    desk = Desk(
        taught,
        *hold(Press(1, "place", "nowhere"), 1.0, 1.5),
        *hold(Press(2, "joint", "9"), 2.0, 2.5),
        *hold(Press(3, "place", "ABOVE"), 3.0, 8.0),
        leave(9.0),
    )
    assert Arm(ROBOT).forward(desk.at(8.9)) == pytest.approx(pose, abs=1e-5)
    assert ["nowhere" in desk.said[0], "joints 1 to 6" in desk.said[1], len(desk.said)] == [True, True, 2]


def test_the_operator_s_override_slows_jogging_down_and_while_paused_no_button_moves_the_arm(tmp_path: Path) -> None:
    def operator(seconds: float) -> float:
        return 0.5 if seconds < 5.0 else 0.0 if 6.5 <= seconds < 11.0 else 1.0

    presses = [Press(number, "joint", "1", 1.0, share=2.0) for number in range(1, 5)]
    slow, cut, dead, free = presses
    desk = Desk(
        tmp_path / "t.db",
        *hold(slow, 1.0, 4.0),
        *hold(cut, 5.5, 8.0),  # paused while it is held, let go in the pause
        *hold(dead, 9.0, 10.0),
        *hold(free, 12.5, 13.5),
        leave(15.0),
        operator=operator,
    )
    half = desk.at(4.9)[0] - desk.at(0.9)[0]
    assert JOINT_RAD_S * 2.4 < half < JOINT_RAD_S * (3.0 + BRAKE_MS * 1e-3)
    assert desk.at(7.4)[0] > desk.at(5.4)[0] + 0.1
    assert desk.at(12.4) == pytest.approx(desk.at(7.4), abs=1e-9)
    assert desk.at(14.9)[0] > desk.at(12.4)[0] + 0.1
    assert desk.said == []


def test_at_reduced_speed_a_held_button_moves_joint_and_tool_no_faster_than_that(tmp_path: Path) -> None:
    tool_m_s = 0.25
    share = speed_share(ROBOT, np.array([0.0, 0.0, ROBOT.geometry.flange_m]), tool_m_s)
    place = Press(3, "place", "park", share=4.0)
    turn, rise = Press(1, "joint", "1", 1.0, share=4.0), Press(2, "axis", "dz", 1.0, share=4.0)

    def speeds(limits: Limits) -> tuple[float, float]:
        """Greatest share of a joint's greatest speed, and greatest speed of the tool upwards, m/s."""
        presses = [*hold(turn, 1.0, 3.0), *hold(rise, 5.0, 6.5), *hold(place, 9.0, 10.0)]
        desk = Desk(tmp_path / "t.db", *presses, leave(12.0), limits=limits)
        assert desk.said == []
        for begin_s in (0.9, 4.9, 8.9):
            assert np.abs(desk.at(begin_s + 2.5) - desk.at(begin_s)).max() > 0.01  # each of them moved
        v = np.diff(desk.q, axis=0) / (PERIOD_MS * 1e-3)
        z = np.array([Arm(ROBOT).forward(q)[2, 3] for q in desk.q[:: round(1000.0 / PERIOD_MS)]])
        return float((np.abs(v) / ROBOT.limits.v_max).max()), float(np.diff(z).max())

    as_asked, reduced = speeds((1.0, 0.0)), speeds((share, tool_m_s))
    assert as_asked[0] > 2.0 * share
    assert 0.9 * share < reduced[0] < 1.001 * share
    assert reduced[1] < tool_m_s


def test_a_hand_of_an_arm_that_is_lost_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def lost(_arm: Channel) -> None:
        asked.append(True)
        raise LinkLost("the bridge has gone")

    asked: list[bool] = []
    monkeypatch.setattr(Channel, "OPEN", lost)
    desk = Desk(tmp_path / "taught.db", (1.0, lambda session: session.hand(True)), (1.5, JogSession.leave))
    assert asked
    assert desk.said == []


def test_a_load_is_told_once_nothing_is_held_and_what_is_none_is_refused(tmp_path: Path) -> None:
    loads: list[Deed] = [
        (1.5, lambda session: session.load(1.5, [0.0, 0.0, 50.0])),
        (5.0, lambda session: session.load(1.0, [0.0, 50.0])),
    ]
    desk = Desk(tmp_path / "t.db", *hold(TURN, 1.0, 2.5), *loads, leave(6.0))
    masses = [state.robot.payload_mass for state in desk.states]
    assert set(masses[: round(2.5e3 / PERIOD_MS)]) == {0.0}
    assert masses[-1] == 1.5
    taken, refused = desk.said
    assert taken == "the servo reckons with 1.5 kg in the hand"
    assert refused.startswith("load: setload: a centre has 3 numbers")


@pytest.mark.parametrize("press", [TURN, Press(1, "axis", "dy", 1.0, share=2.0)])
def test_a_held_button_ends_before_a_fence_and_leads_back(press: Press, tmp_path: Path) -> None:
    _, start, end, radius = FenceSet(ROBOT, []).capsules_at(PARK)[-1]
    place = (0.0, max(start[1], end[1]) + radius + 0.1, 0.0)
    wall = Fence(name="wall", shape="plane", bodies="tool", position_m=place, rpy_deg=(0.0, 0.0, 90.0))
    fences = FenceSet(ROBOT, [wall])
    back = replace(press, number=2, way=-1.0)
    with use_fences(fences):
        desk = Desk(tmp_path / "t.db", *hold(press, 1.0, 9.0), *hold(back, 10.0, 11.0), leave(12.5))
    distances = [fences.distances(q)[0] for q in desk.q]
    assert 0.018 < min(distances) < 0.035
    assert desk.at(9.9) == pytest.approx(desk.at(8.9), abs=1e-9)  # at rest there, with the button down
    assert distances[-1] > min(distances) + 0.02


def test_a_place_past_a_fence_is_not_gone_to_and_the_page_is_told_why(tmp_path: Path) -> None:
    ceiling = Fence(name="ceiling", shape="plane", position_m=(0.0, 0.0, 0.6), rpy_deg=(0.0, 180.0, 0.0))
    with use_fences(FenceSet(ROBOT, [ceiling])):
        desk = Desk(tmp_path / "t.db", *hold(Press(1, "place", "ready", 1.0), 1.0, 2.0), leave(3.0))
    assert np.ptp(desk.q, axis=0).max() < 1e-9
    assert len(desk.said) == 1
    assert "not done: move to ready" in desk.said[0]
    assert "fence 'ceiling'" in desk.said[0]
