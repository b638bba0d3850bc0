"""ARCL's types (Corke & Kirkham, Table 1): what each is, in millimetres and degrees."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot import arcl
from qrobot.arcl import (
    EQ,
    FNDEF,
    HOLD,
    MOV_CONFIG,
    MOV_JVEL,
    MOV_NOTIFY,
    MOV_SHARE,
    MOV_SYNC,
    MOV_TACC,
    MOV_TIME,
    MOV_TRAJ,
    MOV_VT,
    T6,
    TL,
    TRAJ_CART,
    Diff,
    Jacob,
    Vector,
    diff_in,
    diff_of,
    force_from,
    makeposition,
    new_diff,
    new_force,
    new_quat,
    new_quat_rotvec,
    new_trans,
    new_trans_diff,
    new_trans_eul,
    new_trans_quatvect,
    new_trans_rotvec,
    new_trans_rpy,
    new_trans_tr,
    quat_interp,
    quat_invert,
    quat_mult,
    quatvect_of,
    trans_invert,
    trans_mult,
    trans_rpy,
    vect_cross,
    vect_dot,
    vect_unit,
    xunit,
    yunit,
    zunit,
)
from qrobot.arcl.attributes import Attribute
from qrobot.arcl.options import MotionOptions
from qrobot.arcl.switches import Switches
from qrobot.errors import ConfigError, MotionError
from qrobot.motion import Equation
from tests.support.thorough import examples


def test_constructors_take_millimetres_and_degrees() -> None:
    work = new_trans_rotvec("work", -100.0, 50.0, 345.0, yunit, 30.0)
    assert np.allclose(work.value[:3, 3], [-0.1, 0.05, 0.345])
    assert np.allclose(work.value[:3, 0], [np.cos(np.pi / 6), 0.0, -0.5])
    same = new_trans_rpy("work", -100.0, 50.0, 345.0, 0.0, 30.0, 0.0)
    assert np.allclose(work.value, same.value)
    assert np.allclose(new_trans_eul("e", 0, 0, 0, 0.0, 30.0, 0.0).value[:3, :3], work.value[:3, :3])


def test_fields_of_a_transform_are_read_and_written_in_place() -> None:
    stand = new_trans_tr("stand", 600.0, 100.0, 500.0)
    stand.t_p.x += 12.5
    assert (stand.t_p.x, stand.t_p.y, stand.t_p.z) == pytest.approx((612.5, 100.0, 500.0))
    assert list(stand.t_a) == [0.0, 0.0, 1.0]
    assert [*stand.t_n, *stand.t_o] == [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]


def test_transforms_multiply_and_invert() -> None:
    a, b = new_trans_rpy("a", 10, 20, 30, 40, 50, 60), new_trans_tr("b", 1, 2, 3)
    product = trans_mult(new_trans("c"), a, b)
    assert np.allclose(trans_mult(new_trans("d"), trans_invert(new_trans("e"), a), product).value, b.value)
    assert trans_rpy(a) == pytest.approx((40.0, 50.0, 60.0))


def test_a_functional_transform_needs_its_function_and_no_other_takes_one() -> None:
    with pytest.raises(MotionError, match="function"):
        new_trans("weave", FNDEF)
    with pytest.raises(MotionError, match="function"):
        new_trans("weave", HOLD, print)
    with pytest.raises(MotionError, match="kind"):
        new_trans("weave", "fndef")  # type: ignore[arg-type]


def test_vectors_have_the_products_of_vectors() -> None:
    a, b = Vector(1.0, 2.0, 3.0), Vector(-2.0, 0.5, 4.0)
    c = vect_cross(a, b)
    assert vect_dot(a, c) == pytest.approx(0.0)
    assert vect_dot(vect_unit(a), vect_unit(a)) == pytest.approx(1.0)
    assert len(a) == 3
    with pytest.raises(MotionError, match="direction"):
        vect_unit(Vector())
    with pytest.raises(MotionError, match="vector"):
        vect_dot(a, (1.0, 2.0))


def test_quaternions_turn_as_matrices_do() -> None:
    p, q = new_quat_rotvec(yunit, 70.0), new_quat_rotvec((1.0, 1.0, 0.0), -30.0)
    assert np.allclose(quat_mult(p, q).rotation, p.rotation @ q.rotation)
    assert np.allclose(quat_mult(p, quat_invert(p)).rotation, np.eye(3))
    assert new_quat(-2.0, 0.0, 0.0, 0.0) == new_quat(1.0, 0.0, 0.0, 0.0)
    with pytest.raises(MotionError):
        new_quat(0.0, 0.0, 0.0, 0.0)


def test_interpolation_of_quaternions_keeps_to_one_axis_and_the_shorter_arc() -> None:
    begin, end = new_quat_rotvec(yunit, -10.0), new_quat_rotvec(yunit, 110.0)
    for share in (0.0, 0.25, 0.5, 1.0):
        wanted = new_quat_rotvec(yunit, -10.0 + 120.0 * share)
        assert np.allclose(quat_interp(begin, end, share).rotation, wanted.rotation)
    over = new_quat_rotvec(yunit, 200.0)
    half = quat_interp(new_quat_rotvec(yunit, 0.0), over, 0.5)
    assert np.allclose(half.rotation, new_quat_rotvec(yunit, -80.0).rotation)


def test_a_quaternion_and_a_vector_are_a_pose() -> None:
    a = new_trans_rpy("a", 10, 20, 30, 40, 50, 60)
    pose = quatvect_of(a)
    assert list(pose.v) == pytest.approx([10.0, 20.0, 30.0])
    assert np.allclose(new_trans_quatvect("b", pose).value, a.value)


def test_a_force_does_the_same_work_along_a_displacement_in_either_frame() -> None:
    T = new_trans_rpy("T", 100.0, -50.0, 30.0, 20.0, -35.0, 70.0)
    here, force = new_diff(0.1, -0.2, 0.05, 0.01, 0.02, -0.03), new_force(3.0, -4.0, 5.0, 0.1, 0.2, -0.3)
    there = diff_in(T, here)
    assert force.wrench @ there.twist == pytest.approx(force_from(T, force).wrench @ here.twist)


@pytest.mark.parametrize("degrees", [0.0, 0.001, 1.0, 89.0, 91.0, 179.9])
def test_a_displacement_is_a_transform_and_back(degrees: float) -> None:
    given = new_diff(0.01, -0.02, 30.0, 0.6 * degrees, -0.64 * degrees, 0.48 * degrees)
    back = diff_of(new_trans_diff("d", given))
    assert isinstance(back, Diff)
    assert np.allclose(back.twist, given.twist, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("axis", [xunit, yunit, zunit])
def test_a_half_turn_is_a_displacement_of_180_degrees_about_its_axis_either_way(axis: Vector) -> None:
    turn = new_trans_rotvec("half", 1.0, 2.0, 3.0, axis, 180.0)
    back = diff_of(turn)
    assert np.allclose(np.abs(list(back.r)), 180.0 * np.abs(list(axis)))
    assert np.allclose(new_trans_diff("again", back).value, turn.value)


def test_a_jacobian_carries_rates_and_forces() -> None:
    J = Jacob(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    rates = np.arange(6.0)
    force = new_force(1, 2, 3, 4, 5, 6)
    assert force.wrench @ J.velocity(rates) == pytest.approx(J.torques(force) @ rates)
    assert np.allclose(J.inverse() @ J.velocity(rates), rates)


def test_makeposition_reads_like_the_equation() -> None:
    base, tool = new_trans_tr("base", 0, 0, 300), new_trans_tr("tool", 0, 0, 170)
    stand, work = new_trans_tr("stand", 600, 100, 500), new_trans_rotvec("work", -100, 50, 345, yunit, 30)
    pos = makeposition(base, T6, tool, EQ, stand, work, TL, tool)
    T6_goal = pos.equation.goal().pose(0)
    assert np.allclose(base.value @ T6_goal @ tool.value, stand.value @ work.value)
    assert np.allclose(1e3 * T6_goal[:3, 3], [415.0, 150.0, 397.776], atol=1e-3)  # programs.md S-11
    assert (pos.name, makeposition("over", T6, tool, EQ, work, TL, tool).name) == ("pos", "over")


@pytest.mark.parametrize("terms", [(), (T6,), (EQ, T6, TL), (T6, EQ, 3, TL, T6), (T6, EQ, EQ, TL, T6), ("name",)])
def test_a_position_equation_that_makes_no_sense_is_refused(terms: tuple) -> None:
    with pytest.raises(MotionError):
        makeposition(*terms)


def test_sticky_attributes_stay_and_the_others_count_once() -> None:
    said = MotionOptions().changed_by(
        "move",
        (
            MOV_TRAJ,
            TRAJ_CART,
            MOV_VT,
            40,
            MOV_TACC,
            150,
            MOV_TIME,
            2000,
            MOV_CONFIG,
            "lun",
            MOV_SYNC,
            MOV_NOTIFY,
            print,
            0,
        ),
    )
    assert (said.traj, said.vt, said.ta_ms, said.tseg_ms, said.config, said.sync) == (2, 40, 150, 2000, "lun", True)
    later = said.sticky()
    assert (later.traj, later.vt, later.ta_ms) == (2, 40, 150)
    assert (later.tseg_ms, later.config, later.sync, later.notify) == (0.0, None, False, None)


@pytest.mark.parametrize("end", [(), (0,), (None,)])
def test_a_list_of_attributes_ends_with_0_with_none_or_by_itself(end: tuple) -> None:
    assert MotionOptions().changed_by("move", (MOV_TIME, 500, *end)).tseg_ms == 500


@pytest.mark.parametrize(
    "given",
    [
        (MOV_TIME,), (MOV_TIME, -1), (MOV_TIME, float("nan")), (MOV_TIME, "soon"), (MOV_TRAJ, 3), (MOV_CONFIG, "lrn"),
        (MOV_NOTIFY, 3), (MOV_SHARE, 101), (MOV_JVEL, 0), (999, 1), ("MOV_TIME", 1), (0, MOV_TIME, 1), (True, 1),
        (1, 2),
    ],
)  # fmt: skip
def test_attributes_that_cannot_be_are_refused(given: tuple) -> None:
    with pytest.raises(MotionError):
        MotionOptions().changed_by("move", given)


def test_switches_are_taken_out_of_the_command_line() -> None:
    argv, switches = ["prog", "+tr", "part", "+m", "+ami", "offline", "-x"], Switches()
    switches.take(argv)
    assert argv == ["prog", "part", "-x"]
    assert (switches.transforms, switches.motions, switches.equations, switches.ami) == (True, True, False, "offline")


@pytest.mark.parametrize("word", ["+what", "+ami", "+"])
def test_a_switch_that_nobody_knows_is_refused(word: str) -> None:
    with pytest.raises(ConfigError):
        Switches().take(["prog", word])


WORDS = st.one_of(
    st.sampled_from([*Attribute, 0, None, "lun", True, -1, 2, 1e9, float("nan"), print, T6, b"x", (1, 2)]),
    st.integers(-5, 120),
    st.floats(),
    st.text(max_size=4),
)


@given(words=st.lists(WORDS, max_size=8))
@settings(max_examples=examples(200))
def test_any_list_of_attributes_gives_options_or_a_plain_refusal(words: list) -> None:
    try:
        options = MotionOptions().changed_by("move", words)
    except MotionError:
        return
    assert options.traj in (1, 2)
    assert options.ta_ms >= 0.0
    assert 0.0 < options.share <= 100.0


def test_a_misspelt_field_of_a_vector_is_an_error() -> None:
    trans = arcl.new_trans("v", arcl.VARB)
    for thing in (trans.t_p, arcl.new_vector(1.0, 2.0, 3.0)):
        with pytest.raises(AttributeError):
            thing.Z = -50.0
        with pytest.raises(MotionError, match="a coordinate is a number"):
            thing.x = "a"
    for name in ("x", "tp", "t_p"):
        with pytest.raises(AttributeError):
            setattr(trans, name, 5)


@pytest.mark.parametrize("call", [arcl.trans_assign, arcl.trans_invert, lambda t, x: arcl.trans_mult(t, t, x)])
def test_what_is_no_transform_is_told(call) -> None:
    with pytest.raises(MotionError, match="a transform is needed, not 5"):
        call(arcl.new_trans("t"), 5)


@pytest.mark.parametrize("matrix", [5, np.zeros(6), np.zeros((5, 6))])
def test_a_jacobian_has_six_rows(matrix) -> None:
    with pytest.raises(MotionError, match="six rows"):
        arcl.Jacob(matrix)


WRONG = {
    "a name": lambda: new_trans(5),
    "another name": lambda: new_trans_tr(None, 1, 0, 0),
    "no function": lambda: new_trans("x", FNDEF, "no"),
    "a semaphore": lambda: arcl.new_sem(5),
    "a product": lambda: trans_mult(5, T6, T6),
    "a copy": lambda: arcl.trans_assign(None, T6),
    "an inverse": lambda: trans_invert("x", T6),
    "a vector": lambda: arcl.new_vector("a", 1, 2),
    "no vector": lambda: arcl.new_vector(float("nan"), 1, 2),
    "0 within": lambda: makeposition(T6, 0, EQ, T6, TL, T6),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_no_argument_is_told_as_an_error_of_ours(wrong: str) -> None:
    with pytest.raises(MotionError, match=r"name|needed|function|no transform"):
        WRONG[wrong]()


def test_a_list_of_terms_may_be_closed_by_0() -> None:
    base, tool, work = new_trans_tr("base", 0, 0, 300), new_trans_tr("tool", 0, 0, 170), new_trans_tr("work", 1, 2, 3)
    closed, left_open = (makeposition(base, T6, tool, EQ, work, TL, tool, *end).target for end in ((0,), ()))
    assert isinstance(closed, Equation)
    assert str(closed) == str(left_open)
