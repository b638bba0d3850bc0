"""Two arms side by side: whoever moves stops before the other, and nobody moves beside an arm that is not heard of."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.cli.arms import choose_arm, neighbours_of_arm
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config import load_deployment
from qrobot.errors import ConfigError, LinkError
from qrobot.faultcodes import FaultCode
from qrobot.fences.gate import CREEP_M, REACTION_S, way_of_stop
from qrobot.modecodes import Mode
from qrobot.realtime.structure import view_words
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import FLAG_CALIBRATED, ServoSnapshot
from qrobot.servo.memory.servo_memory import create_servo_memory
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.neighbour import (
    FREE,
    LOOK_S,
    LOOKS,
    N_NEIGHBOUR,
    NOT_HEARD_OF,
    TOO_NEAR,
    VERDICT,
    Neighbour,
    NeighbourLook,
    distances_at_stops,
    neighbour_between,
)
from qrobot.servo.process.neighbour_look import RETRY_S, OtherServo, looking
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support import fences as slowly
from tests.support.patience import give_time, wait_until
from tests.support.puma import PARK, ROBOT

CELL = """
[[arm]]
name = "left"
robot = "puma560"
bridge = { port = 5600 }
stand = { position_m = [0.0, 0.0, 0.0] }
fences = { arms = ["right"], arm_margin_m = 0.04 }

[[arm]]
name = "right"
robot = "puma560"
bridge = { port = 5601 }
stand = { position_m = [1.5, 0.1, 0.0], rpy_deg = [180.0, 0.0, 0.0] }
fences = { arms = ["left"], arm_margin_m = 0.04 }
"""
MARGIN_M = 0.04
REACH = np.array([-0.2, 0.3, -0.6, 0.0, 0.0, 0.0])  # from park, towards the other arm
FRAME_S, PERIOD_S = 0.025, 0.001
TURNS = np.array([1.0, 0.0, -0.5, 0.0, 0.0, 0.0])  # rad/s
MIDDLE = np.diag([-1.0, -1.0, 1.0])  # right's axes in those of left


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A deployment of two arms that face each other."""
    path = tmp_path_factory.mktemp("cell") / "cell.toml"
    path.write_text(CELL)
    return str(path)


class Pair:
    """Two emulated arms under power, in lock-step with each other and with their looks."""

    def __init__(self, file: str) -> None:
        self.rigs, self.looks, self.looking = [], [], [True, True]
        for name in ("left", "right"):
            neighbours = neighbours_of_arm(choose_arm(file, name), file)
            settings = ServoSettings(rate_hz=1000.0, neighbours=neighbours)
            self.rigs.append(LockstepRig(ROBOT, settings, Emulator(ROBOT, physics="rigid"), keep_telemetry=False))
        self.heard: list[Callable[[], ServoSnapshot | None]] = [rig.mailbox.snapshot for rig in self.rigs]
        for k, rig in enumerate(self.rigs):
            (neighbour,) = rig.settings.neighbours
            words = rig.state.neighbour[0]
            hear = lambda k=k: self.heard[1 - k]()  # noqa: E731
            own = rig.mailbox.snapshot
            self.looks.append(NeighbourLook(neighbour, own, hear, words, self.now_s, PERIOD_S))
        self.pair = self.rigs[0].settings.neighbours[0].pair
        self.seconds(0.1)
        for rig in self.rigs:
            rig.mailbox.request_power(True)
        self.seconds(0.4)
        self._stream = 0

    def now_s(self) -> float:
        return self.rigs[0].now_ns * 1e-9

    def seconds(self, seconds: float) -> float:
        """Let both go on; the least distance meanwhile."""
        least = np.inf
        for _ in range(round(seconds / LOOK_S)):
            for rig, look, looks in zip(self.rigs, self.looks, self.looking, strict=True):
                rig.ticks(round(LOOK_S * rig.settings.rate_hz))
                if looks:
                    look.look()
            least = min(least, self.distance())
        return float(least)

    def distance(self) -> float:
        left, right = (rig.mailbox.snapshot() for rig in self.rigs)
        return self.pair.distance(left.q, right.q)

    def lead(
        self, movers: tuple[int, ...], way: Floats, speed: float, seconds: float, halfway: Callable[[], object] = int
    ) -> float:
        """Setpoints of some arms, at most of `speed`; the least distance meanwhile. `halfway` is done in the middle."""
        least, starts = np.inf, [rig.mailbox.snapshot().q_setpoint for rig in self.rigs]
        self._stream += 1
        steps = round(seconds / FRAME_S)
        for step in range(steps):
            part = min(1.0, speed * step * FRAME_S / (1.5 * float(np.abs(way).max())))
            share = part * part * (3.0 - 2.0 * part)
            for k in movers:
                rig, values = self.rigs[k], (starts[k] + share * way).tolist()
                kinds = [POSITION_SETPOINT] * ROBOT.n
                rig.mailbox.push_setpoint(self._stream, step, rig.now_ns, round(FRAME_S * 1e9), kinds, values)
            if step == steps // 2:
                halfway()
            least = min(least, self.seconds(FRAME_S))
        return least

    def codes(self) -> list[int]:
        return [rig.mailbox.snapshot().event for rig in self.rigs]

    def modes(self) -> list[Mode]:
        return [Mode(rig.mailbox.snapshot().mode) for rig in self.rigs]


def test_the_distance_of_two_arms_is_that_of_the_nearest_of_many_points(file: str) -> None:
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    random = np.random.default_rng(106)
    for _ in range(4):
        q, other = (PARK + random.uniform(-0.5, 0.5, 6) for _ in range(2))
        least = np.inf
        for one in ROBOT.shape.capsules:
            for two in ROBOT.shape.capsules:
                if one.link == two.link == 0:
                    continue
                a = slowly.axis_points(ROBOT, one, q, 201)
                b = slowly.axis_points(ROBOT, two, other, 201) @ MIDDLE.T + [1.5, 0.1, 0.0]
                between = np.linalg.norm(a[:, None, :] - b[None, :, :], axis=2).min()
                least = min(least, between - one.radius_m - two.radius_m)
        assert neighbour.pair.distance(q, other) == pytest.approx(least, abs=2e-3)


@pytest.mark.parametrize(("movers", "speed"), [((0,), 0.3), ((1,), 0.9), ((0, 1), 0.9)])
def test_arms_that_move_stop_before_each_other_and_one_that_rests_is_left_alone(
    file: str, movers: tuple[int, ...], speed: float
) -> None:
    cell = Pair(file)
    ends = [PARK + REACH if k in movers else PARK for k in (0, 1)]
    assert cell.pair.distance(*ends) < 0.0
    least = cell.lead(movers, REACH, speed, 3.0)
    assert MARGIN_M - 0.002 <= least < MARGIN_M + 0.05
    assert cell.modes() == [Mode.HOLDING, Mode.HOLDING]
    assert [code == FaultCode.FENCE for code in cell.codes()] == [k in movers for k in (0, 1)]
    near = cell.distance()
    cell.lead(movers, -0.5 * REACH, 0.3, 2.0)  # away again
    assert cell.distance() > near + 0.03


@pytest.mark.parametrize("lost", ["hangs", "forgets its place", "is not looked at"])
def test_an_arm_whose_neighbour_is_lost_while_it_moves_is_stopped_and_moves_no_more(file: str, lost: str) -> None:
    cell = Pair(file)
    hear, last = cell.rigs[1].mailbox.snapshot, cell.rigs[1].mailbox.snapshot()
    modes: list[Mode] = []

    def lose() -> None:
        modes.append(cell.modes()[0])
        if lost == "is not looked at":
            cell.looking[0] = False
        else:
            cell.heard[1] = (lambda: last) if lost == "hangs" else lambda: replace(hear(), flags=0)

    cell.lead((0,), -REACH, 0.3, 2.0, lose)
    assert modes == [Mode.TRACKING]
    assert (cell.codes()[0], cell.modes()[0]) == (FaultCode.FENCE, Mode.HOLDING)
    stood = cell.rigs[0].mailbox.snapshot().q
    cell.lead((0,), -REACH, 0.3, 1.0)
    assert cell.codes()[0] == FaultCode.FENCE
    assert cell.rigs[0].mailbox.snapshot().q == pytest.approx(stood, abs=0.02)
    assert lost == "is not looked at" or cell.looks[0].look() == NOT_HEARD_OF


@pytest.mark.parametrize("which", range(3))
@pytest.mark.parametrize(("lost", "soonest_s", "latest_s"), [("is met", 0.0, 0.002), ("hangs", 0.1, 0.103)])
def test_of_three_neighbours_each_one_stops_the_arm(
    file: str, lost: str, soonest_s: float, latest_s: float, which: int
) -> None:
    neighbours = neighbours_of_arm(choose_arm(file, "left"), file) * 3
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0, neighbours=neighbours), Emulator(ROBOT, physics="rigid"))
    told = rig.state.neighbour
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.2)
    start = rig.mailbox.snapshot().q_setpoint
    lost_ns = 0
    for ms in range(400):
        if ms % 25 == 0:
            values = (start - 2e-7 * ms * ms * np.eye(6)[0]).tolist()
            kinds = [POSITION_SETPOINT] * ROBOT.n
            rig.mailbox.push_setpoint(1, ms // 25, rig.now_ns, round(FRAME_S * 1e9), kinds, values)
        looked = [k for k in range(3) if ms < 200 or k != which or lost == "is met"]
        told[looked, LOOKS] += 1.0
        told[which, VERDICT] = TOO_NEAR if lost == "is met" and ms >= 200 else FREE
        lost_ns = rig.now_ns if which in looked and ms <= 200 else lost_ns
        rig.ticks(1)
    rows = rig.rows()
    stop = rows[rows["mode"] == Mode.STOPPING]
    assert stop["fault"][0] == FaultCode.FENCE
    assert soonest_s <= (stop["t_ns"][0] - lost_ns) * 1e-9 <= latest_s


def heard_of_last(
    neighbour: Neighbour, age_s: float, own_s: float | None = None
) -> tuple[float, list[tuple[Floats, Floats]]]:
    """Verdict on two arms that turn towards each other, of which the other one was last heard of then, and where they
    were looked at. The time of the own servo has gone on by `own_s`, as long if left out."""
    seen: list[tuple[Floats, Floats]] = []

    class Pair:
        def distance(self, q: Floats, other_q: Floats) -> float:
            seen.append((q.copy(), other_q.copy()))
            return 1.0

    state = {"q": PARK, "v": TURNS, "tick": 7, "t_ns": 0, "flags": FLAG_CALIBRATED, "mode": Mode.TRACKING}
    own, other = (SimpleNamespace(**state) for _ in range(2))
    now_s, told, watched = [0.0], np.zeros(N_NEIGHBOUR), replace(neighbour, pair=Pair())  # type: ignore[arg-type]
    look = NeighbourLook(watched, lambda: own, lambda: other, told, lambda: now_s[0], PERIOD_S)  # type: ignore[arg-type, return-value]
    look.look()
    seen.clear()
    now_s[0] = age_s
    own.t_ns = round((age_s if own_s is None else own_s) * 1e9)
    return look.look(), seen


def test_a_neighbour_that_was_not_heard_of_lately_is_taken_to_have_gone_on(file: str) -> None:
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    _, now = heard_of_last(neighbour, 0.0)
    verdict, late = heard_of_last(neighbour, 0.09)
    assert verdict == FREE
    for arm in (0, 1):
        further = late[-1][arm] - now[-1][arm]
        np.testing.assert_allclose(further, 0.09 * TURNS, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(("age_s", "verdict"), [(0.0, FREE), (0.099, FREE), (0.101, NOT_HEARD_OF), (9.0, NOT_HEARD_OF)])
def test_a_state_is_that_of_a_neighbour_for_a_tenth_of_a_second(file: str, age_s: float, verdict: float) -> None:
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    assert heard_of_last(neighbour, age_s)[0] == verdict


@pytest.mark.parametrize(("age_s", "own_s"), [(0.3, 0.002), (0.002, 0.3)], ids=["of the world", "of the own servo"])
def test_a_stall_is_no_silence_of_the_neighbour(file: str, age_s: float, own_s: float) -> None:
    """One of the machine, with all emulated arms; and one of this servo alone, beside a neighbour that is slow."""
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    _, now = heard_of_last(neighbour, 0.0)
    verdict, late = heard_of_last(neighbour, age_s, own_s)
    assert verdict == FREE
    np.testing.assert_allclose(late[-1][1] - now[-1][1], 0.002 * TURNS, rtol=1e-9, atol=1e-15)


def test_a_look_reckons_with_a_cycle_and_a_look_more_than_the_silence(file: str) -> None:
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    _, now = heard_of_last(neighbour, 0.0)
    late_s = LOOK_S + PERIOD_S + REACTION_S + neighbour.other_overshoot_s
    way = way_of_stop(TURNS, neighbour.other_a_stop, late_s)
    np.testing.assert_allclose(now[-1][1] - now[0][1], way, rtol=1e-9, atol=1e-15)


def test_arms_within_the_margin_may_part_and_come_no_nearer(file: str) -> None:
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    look = NeighbourLook(neighbour, lambda: None, lambda: None, np.zeros(N_NEIGHBOUR), lambda: 0.0, PERIOD_S)
    assert look._judge(np.array([0.03, 0.031, 0.05]), tracks=True) == FREE
    assert look._judge(np.array([0.03, 0.031, 0.028]), tracks=True) == TOO_NEAR
    assert look._judge(np.array([0.05, 0.045, 0.039]), tracks=True) == TOO_NEAR
    assert look._judge(np.array([np.nan, np.nan]), tracks=True) == TOO_NEAR


def test_arms_within_the_margin_do_not_creep_nearer_in_one_run_of_setpoints(file: str) -> None:
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    look = NeighbourLook(neighbour, lambda: None, lambda: None, np.zeros(N_NEIGHBOUR), lambda: 0.0, PERIOD_S)

    def creep(begin_m: float) -> list[float]:
        """Verdicts on the way, by 3 mm/s, at which no single look sees a tenth of a millimetre."""
        now = begin_m - 1.5e-5 * np.arange(400)
        return [look._judge(np.array([near, near - 9e-5]), tracks=True) for near in now]

    verdicts = creep(0.03)
    assert verdicts.index(TOO_NEAR) == pytest.approx((CREEP_M - 9e-5) / 1.5e-5, abs=2)
    assert look._judge(np.array([0.024, 0.024]), tracks=False) == FREE  # held: the next run begins where it stands
    assert look._judge(np.array([0.024, 0.025]), tracks=True) == FREE
    assert creep(0.024)[10] == FREE
    assert look._judge(np.array([0.035, 0.036]), tracks=True) == FREE  # parted
    assert look._judge(np.array([0.034, 0.0329]), tracks=True) == TOO_NEAR


@pytest.mark.realtime
def test_the_servo_s_thread_looks_at_another_servo_whenever_it_comes_and_goes(file: str) -> None:
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    other = replace(neighbour, name=f"t{uuid.uuid4().hex[:10]}")
    cell, told, said = Pair(file), np.zeros((4, N_NEIGHBOUR)), list[str]()
    with looking([other], cell.rigs[0].mailbox, told, said.append):
        wait_until(lambda: told[0, LOOKS] > 2, "it looks")
        assert told[0, VERDICT] == NOT_HEARD_OF
        assert said == [f"{other.name} is not heard of: this arm does not move"]
        with create_servo_memory(other.name, "puma560", "pd", ROBOT.n, 1_000_000, 16) as memory:
            there = view_words(ServoMailbox(memory.words).memory.published)

            def heard() -> bool:
                cell.rigs[1].ticks(1)
                there[:] = view_words(cell.rigs[1].mailbox.memory.published)
                return bool(told[0, VERDICT] != NOT_HEARD_OF)

            wait_until(heard, "it is heard of")
        wait_until(lambda: told[0, VERDICT] == NOT_HEARD_OF, "it has gone")
    looks = told[0, LOOKS]
    give_time()
    assert told[0, LOOKS] == looks
    assert not told[1:].any()


@pytest.mark.realtime
def test_the_servo_s_thread_goes_on_looking_after_states_of_its_own_loop_that_cannot_be_read(file: str) -> None:
    (neighbour,) = neighbours_of_arm(choose_arm(file, "left"), file)
    other = replace(neighbour, name=f"t{uuid.uuid4().hex[:10]}")
    told, read = np.zeros((4, N_NEIGHBOUR)), list[int]()

    def snapshot() -> None:
        read.append(len(read))
        if len(read) <= 3:
            raise LinkError("the servo's state cannot be read")

    mailbox = SimpleNamespace(snapshot=snapshot, info=SimpleNamespace(period_ns=PERIOD_S * 1e9))
    with looking([other], cast(ServoMailbox, mailbox), told, lambda _: None):
        wait_until(lambda: told[0, LOOKS] > 2, "it looks")


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('arms = ["right"]', 'arms = ["middle"]', "names 'middle', which is no other arm"),
        ('arms = ["right"]', 'arms = ["left"]', "names 'left', which is no other arm"),
        ("stand = { position_m = [0.0, 0.0, 0.0] }", "", r"\[arm.stand\] of left is missing"),
        (", rpy_deg = [180.0, 0.0, 0.0] }", " }", ""),
        ("[1.5, 0.1, 0.0], rpy_deg = [180.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "left and right have the same stand"),
    ],
)
def test_a_mistake_about_other_arms_is_told(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(CELL.replace(old, new))
    if complaint:
        with pytest.raises(ConfigError, match=complaint):
            load_deployment(path)
    else:
        assert len(load_deployment(path).arm) == 2


def test_an_arm_without_a_body_beside_another_is_told_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("qrobot.cli.doctor.all_findings", lambda _ports, _bases: [])
    path = tmp_path / "cell.toml"
    path.write_text(
        CELL.replace('robot = "puma560"\nbridge = { port = 5601', 'robot = "stanford"\nbridge = { port = 5601')
    )
    assert run_app(make_app(), ["doctor", str(path)]) == 1
    assert "stanford has no [shape]" in capsys.readouterr().out
    assert run_app(make_app(), ["up", str(path)]) == 1
    assert "stanford has no [shape]" in capsys.readouterr().err


def test_each_arm_has_a_tool_of_its_own_thickness(tmp_path: Path) -> None:
    """Seen from either arm the two are as far apart."""
    path = tmp_path / "cell.toml"
    thin, fat = CELL.replace("fences", "servo = { tool_mm = [0, 0, 200] }\nfences").split("[[arm]]")[1:]
    fat = fat.replace("0.04 }", "0.04, tool_radius_m = 0.12 }")
    path.write_text(f"[[arm]]{thin}[[arm]]{fat}")
    left, right = load_deployment(str(path)).arm
    q, other_q = PARK + REACH, PARK + 0.5 * REACH
    one = neighbour_between(left, right, ROBOT, ROBOT).pair.distance(q, other_q)
    other = neighbour_between(right, left, ROBOT, ROBOT).pair.distance(other_q, q)
    assert one == pytest.approx(other, abs=1e-9)


def test_the_way_of_both_stops_is_half_of_that_at_full_speed_and_what_each_arm_is_late_and_outruns_its_reference_by(
    file: str,
) -> None:
    """A stop lasts 15/8 of the speed over the deceleration: the steepest slope of its profile is that of the limit."""
    neighbour = neighbours_of_arm(choose_arm(file, "left"), file)[0]
    a_stop, overshoot_s = ROBOT.guard.a_stop, float(np.sqrt(ROBOT.control.inertia / ROBOT.control.kp).max() / np.e)
    seen: list[tuple[Floats, Floats]] = []

    class Pair:
        def distance(self, q: Floats, other_q: Floats) -> float:
            seen.append((q.copy(), other_q.copy()))
            return 1.0

    moving = [SimpleNamespace(q=PARK, v=v) for v in (np.array([0.5, 0.0, -0.2, 0.0, 0.0, 0.0]), np.zeros(6))]
    distances_at_stops(replace(neighbour, pair=Pair()), *moving, 0.02)  # type: ignore[arg-type]
    v = moving[0].v
    seconds = 0.5 * 15.0 / 8.0 * float((np.abs(v) / a_stop).max()) + 0.02 + REACTION_S + overshoot_s
    np.testing.assert_allclose(seen[-1][0] - seen[0][0], v * seconds, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(seen[-1][1], seen[0][1])  # the other one rests


def test_a_servo_is_believed_as_long_as_it_drives_the_robot_of_the_deployment_file() -> None:
    name, now_s = f"n{uuid.uuid4().hex[:8]}", [0.0]
    other = OtherServo(name, "puma560", 6, lambda: now_s[0])
    for robot, n in (("puma560", 6), ("stanford", 6), ("puma560", 5), ("puma560", 6)):
        with create_servo_memory(name, robot, "pd", n, 1_000_000, 16) as servo:
            for drives in (robot, "ur5e", robot):  # started anew in the same file, out of another deployment file
                servo.front.info.robot_name = drives.encode()
                servo.front.header.generation += 1
                now_s[0] += RETRY_S
                believed = (drives, n) == ("puma560", 6)
                assert (other.snapshot() is not None) is believed
                wrong = "5 joints, not 6" if drives == "puma560" else f"{drives!r}, not 'puma560'"
                assert other.mismatch == ("" if believed else f"the servo of {name} drives {wrong}")
    now_s[0] += RETRY_S
    assert (other.snapshot(), other.mismatch) == (None, "")
