"""Reduced speed: the tool's tip keeps its limit, or the arm is stopped on its path."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot import arcl, rccl, rci
from qrobot.config import load_robot
from qrobot.config.deployment import ServoChoice
from qrobot.errors import ConfigError, TooFast
from qrobot.faultcodes import FaultCode, explain
from qrobot.modecodes import Mode
from qrobot.model.arm import Arm
from qrobot.model.chain import chain_params
from qrobot.motion import Termination
from qrobot.rccl.channel import Channel
from qrobot.rccl.transforms import made_transform
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.checks.tip_speed import check_tip_speed, tip_speed
from qrobot.servo.settings import ServoSettings
from qrobot.servo.speed_share import speed_share
from qrobot.sim_board.emulator import Emulator
from tests.support.arcl import forget_programs
from tests.support.puma import ROBOT
from tests.support.servo_bench import ServoBench, cruise, moving, play

LIMIT = 0.25
STEP_S = 1e-6


@pytest.mark.parametrize("name", ["puma560", "stanford"])
@given(data=st.data())
def test_the_speed_of_the_tip_is_that_of_its_path(name: str, data: st.DataObject) -> None:
    robot = load_robot(name)
    arm, chain = Arm(robot), chain_params(robot)
    q = np.array([data.draw(st.floats(*ends)) for ends in zip(robot.limits.q_min, robot.limits.q_max, strict=True)])
    v = np.array([data.draw(st.floats(-most, most)) for most in robot.limits.v_max])
    tip = np.array([data.draw(st.floats(-0.5, 0.5)) for _ in range(3)])
    ends = [(arm.forward(q + sign * STEP_S * v) @ [*tip, 1.0])[:3] for sign in (-1.0, 1.0)]
    expected = np.linalg.norm(ends[1] - ends[0]) / (2.0 * STEP_S)
    assert tip_speed(q, v, chain, tuple(tip)) == pytest.approx(expected, abs=1e-6, rel=1e-6)


@pytest.mark.parametrize(
    ("speed", "passes"), [(0.0, 1), (LIMIT, 1), (np.nextafter(LIMIT, 1), 0), (np.nan, 0), (np.inf, 0)]
)
def test_only_a_number_up_to_the_limit_passes(speed: float, passes: int) -> None:
    assert (check_tip_speed(speed, LIMIT) == 0) == bool(passes)


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_joints_that_keep_their_share_of_speed_keep_the_limit_of_the_tool(name: str) -> None:
    robot, rng, tip = load_robot(name), np.random.default_rng(8), np.array([0.0, 0.0, 0.2])
    limits, chain, share = robot.limits, chain_params(robot), speed_share(load_robot(name), tip, LIMIT)
    q, v = rng.uniform(limits.q_min, limits.q_max, (2000, robot.n)), rng.choice([-1.0, 1.0], (2000, robot.n))
    speeds = [tip_speed(at, share * limits.v_max * way, chain, tuple(tip)) for at, way in zip(q, v, strict=True)]
    assert 0.5 * LIMIT < max(speeds) <= 1.02 * LIMIT
    assert speed_share(robot, tip, 0.0) == speed_share(robot, tip, 1e3) == 1.0


def by_rccl(set_speed: Callable[[Channel], object] = lambda _: None) -> None:
    with rccl.control(ROBOT.name) as arm:
        assert (arm.how.tool_speed_limit, 0 < arm.how.speed_limit < 0.5) == (LIMIT, True)
        set_speed(arm)
        arm.move(arm.jposition("beside", np.degrees(ROBOT.poses["end"])))
        arm.waitfor(arm.completed)


RCCL = {
    "as it is": lambda _: None,
    "joint speed": lambda arm: arm.setjvel(1.0),
    "time": lambda arm: arm.setime(100, 400),
}


def straight(set_speed: Callable[[Channel], object], mm: float) -> None:
    """By Cartesian motions, whose every setpoint is judged."""
    with rccl.control(ROBOT.name) as arm:
        here = made_transform("HERE", "const", Arm(ROBOT).forward(np.array(arm.how.q_setpoint)))
        up = rccl.gentr_trsl("UP", 0.0, 0.0, mm)
        beside = rccl.makeposition("BESIDE", rccl.t6, rccl.EQ, up, here, rccl.TL, rccl.t6)
        arm.setmode("cartesian")
        set_speed(arm)
        arm.move(beside)
        arm.waitfor(arm.completed)
        assert beside.code == Termination.COMPLETED


STRAIGHT = {"tool speed": lambda arm: arm.setvel(400.0, 90.0)} | {
    f"{ta} and {ts} ms": partial(lambda arm, ta, ts: arm.setime(ta, ts), ta=ta, ts=ts)
    for ta, ts in ((28, 280), (56, 420), (100, 400), (100, 700))
}


def by_arcl() -> None:
    """As fast as the joints may be, which is too fast for the tool."""
    forget_programs()
    rp = arcl.arcl_open(0)
    try:
        arcl.move(rp, rp.pose("end"), arcl.MOV_SHARE, 100, 0)
        arcl.arcl_close(rp)
    finally:
        forget_programs()


@pytest.mark.parametrize("program", [*(partial(by_rccl, each) for each in RCCL.values()), by_arcl], ids=[*RCCL, "arcl"])
def test_a_program_at_reduced_speed_goes_slowly_instead_of_being_stopped(program: Callable[[], None]) -> None:
    assert 0.2 * LIMIT < fastest_tip_of(program) <= LIMIT


@pytest.mark.sampled(8)
@pytest.mark.parametrize("mm", [15.0, 26.0, 40.0])
@pytest.mark.parametrize("set_speed", STRAIGHT.values(), ids=STRAIGHT)
def test_so_does_a_straight_motion_to_its_end(set_speed: Callable[[Channel], object], mm: float) -> None:
    assert fastest_tip_of(partial(straight, set_speed, mm)) <= LIMIT


def fastest_tip_of(program: Callable[[], None]) -> float:
    """Run it at reduced speed, which nothing may end; m/s."""
    settings = ServoSettings(rate_hz=500.0, reduced_speed_m_s=LIMIT)
    rig = LockstepRig(ROBOT, settings, Emulator(ROBOT, physics="rigid", start=ROBOT.poses["end"] + 0.1))
    links = partial(link_factory, rig, 28_000)
    with rccl.use(links), rci.use(links):
        program()
    rows, tip = rig.rows(), tuple(np.array(rig.params.tip))
    chain = chain_params(ROBOT)
    assert rig.mailbox.snapshot().event == 0
    return max(tip_speed(row["q_ref"].copy(), row["v_ref"].copy(), chain, tip) for row in rows[::50])


def test_what_full_speed_does_not_allow_is_refused_at_reduced_speed_too() -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=500.0, reduced_speed_m_s=LIMIT), Emulator(ROBOT, physics="rigid"))
    with rccl.use(partial(link_factory, rig, 28_000)), rccl.control(ROBOT.name) as arm:
        arm.setjvel(2.0 * float(max(ROBOT.limits.v_max)))
        with pytest.raises(TooFast):
            arm.move(arm.pose("end"))


def speed_at(bench: ServoBench) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    tip = tuple(np.array(bench.params.tip))
    chain = chain_params(bench.robot)
    return np.array([tip_speed(row["q_ref"].copy(), row["v_ref"].copy(), chain, tip) for row in bench.rows()])


@pytest.mark.parametrize("tool_m", [(0.0, 0.0, 0.0), (0.3, 0.0, 0.2)])
def test_a_fast_program_is_stopped_on_its_path_before_the_tool_is_faster(tool_m: tuple[float, float, float]) -> None:
    bench = ServoBench(reduced_speed_m_s=LIMIT, tool_m=tool_m).hold()
    play(bench, cruise(bench.q, np.array([1.0, 0, 0, 0, 0, 0])))
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is FaultCode.T1_LIMIT
    bench.until(lambda: bench.mode is Mode.HOLDING)
    speeds = speed_at(bench)
    assert 0.8 * LIMIT < speeds.max() < 1.02 * LIMIT
    assert bench.powered


@pytest.mark.parametrize(("share", "mode"), [(0.98, Mode.TRACKING), (1.02, Mode.HOLDING)])
def test_the_limit_is_that_of_the_tool_and_not_of_the_flange(share: float, mode: Mode) -> None:
    bench = ServoBench(reduced_speed_m_s=LIMIT, tool_m=(0.0, 0.0, 0.15))
    tip, unit = tuple(np.array(bench.params.tip)), np.eye(6)[0]
    rate = share * LIMIT / tip_speed(bench.q, unit, chain_params(bench.robot), tip)
    bench.hold()
    play(bench, cruise(bench.q, rate * unit))
    bench.run(1.2)
    assert bench.mode is mode


def start_hard(joint: int, period_ms: int, share: float, periods: int, limit: float = LIMIT) -> ServoBench:
    """An arm whose setpoints come to `share` of LIMIT within so many sample periods, and go on."""
    bench, period_s, unit = ServoBench(reduced_speed_m_s=limit, pose="end").hold(), 1e-3 * period_ms, np.eye(6)[joint]
    tip = tuple(np.array(bench.params.tip))
    rate = share * LIMIT / tip_speed(bench.q, unit, chain_params(bench.robot), tip)
    rates = [0.0, 0.0, *np.minimum(rate, rate / periods * np.arange(1, 14))]
    places = bench.q + np.outer(np.cumsum(rates) * period_s, unit)
    play(bench, lambda t: places[min(round(t / period_s), len(places) - 1)], period_ns=period_ms * 1_000_000)
    bench.run((len(places) - 1) * period_s)
    return bench


@pytest.mark.parametrize(("joint", "period_ms"), [(1, 28), (2, 28), (0, 100), (1, 100), (2, 100)])
def test_a_start_within_one_sample_period_to_nearly_the_limit_is_stopped_with_advice(
    joint: int, period_ms: int
) -> None:
    bench = start_hard(joint, period_ms, 0.99, 1)
    assert (bench.mode, bench.event) == (Mode.HOLDING, FaultCode.T1_LIMIT)
    assert "acceleration" in explain(FaultCode.T1_LIMIT)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("share", "periods"), [(0.86, 1), (0.99, 4)])
@pytest.mark.parametrize(("joint", "period_ms"), [(1, 28), (2, 28), (0, 100), (1, 100), (2, 100)])
def test_a_little_slower_or_gentler_it_is_followed_on_the_path_of_full_speed(
    joint: int, period_ms: int, share: float, periods: int
) -> None:
    bench = start_hard(joint, period_ms, share, periods)
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.NONE)
    assert speed_at(bench).max() > share * LIMIT
    full = start_hard(joint, period_ms, share, periods, limit=0.0)
    assert np.array_equal(bench.rows()["q_ref"], full.rows()["q_ref"])


@pytest.mark.parametrize("way", [-1.0, 1.0])
@pytest.mark.parametrize("joint", range(6))
def test_motion_that_nobody_asked_for_counts_too_up_to_a_fifth_more(joint: int, way: float) -> None:
    for share, told in ((1.1, FaultCode.NONE), (1.3, FaultCode.T1_LIMIT)):
        bench = ServoBench(reduced_speed_m_s=LIMIT, tool_m=(0.2, 0.1, 0.2), pose="ready").hold().tick(20)
        bench.follows, unit = False, np.eye(6)[joint]
        rate = way * share * LIMIT / tip_speed(bench.q, unit, chain_params(bench.robot), tuple(bench.params.tip))
        bench.state.v[joint] = rate
        for _ in range(15):
            bench.q = bench.q + rate * 1e-3 * unit
            bench.tick()
        assert (bench.mode, bench.event) == (Mode.HOLDING, told)


def test_without_a_limit_the_joints_limits_are_all_there_are() -> None:
    bench = ServoBench()
    moving(bench, speed=1.2)
    assert bench.mode is Mode.TRACKING


@pytest.mark.parametrize("wrong", [-0.1, 11.0, np.nan, np.inf])
def test_a_limit_in_other_units_is_refused(wrong: float) -> None:
    with pytest.raises(ConfigError, match="reduced speed"):
        ServoSettings(reduced_speed_m_s=wrong)
    with pytest.raises(ConfigError, match="tool"):
        ServoSettings(tool_m=(0.0, wrong * 1e3, 0.0))


def test_the_deployment_names_limit_and_tool_in_millimetres() -> None:
    choice = ServoChoice.model_validate({"reduced_speed_mm_s": 250, "tool_mm": [0, 0, 120]})
    assert (choice.reduced_speed_mm_s, choice.tool_mm) == (250.0, (0.0, 0.0, 120.0))
