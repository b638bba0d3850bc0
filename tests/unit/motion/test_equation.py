"""Position equations and their terms: what is solved, what is copied when, what is evaluated how often."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from qrobot.errors import MotionError
from qrobot.model.transform import inverse, is_transform, so3_exp, transform
from qrobot.motion import T6, Equation, OrientationInterpolation, TransformKind, Trsf
from qrobot.motion.world.drive_transform import drive, drive_parameters
from qrobot.motion.world.trsf import rigid
from qrobot.rccl.transforms import Transform

RNG = np.random.default_rng(4)
TICK = 7


def some_pose() -> np.ndarray:
    return transform(so3_exp(RNG.uniform(-1, 1, 3)), RNG.uniform(-1, 1, 3))


def term(name: str, kind: TransformKind = TransformKind.CONST) -> Trsf:
    return Trsf(name, kind, some_pose())


REF, TOOL, CONV, OBJ, PG = (term(name) for name in ("REF", "TOOL", "CONV", "OBJ", "PG"))


def side(terms, t6) -> np.ndarray:
    value = np.eye(4)
    for one in terms:
        value = value @ (t6 if one is T6 else one.value)
    return value


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ([T6], [OBJ]),
        ([T6, TOOL], [OBJ]),
        ([REF, T6, TOOL], [CONV, OBJ, PG]),
        ([REF, OBJ, T6, TOOL, PG], [CONV]),
        ([REF, T6, TOOL], []),
    ],
)
def test_the_goal_makes_both_sides_equal_whatever_their_length(left, right) -> None:
    tool = left[-1]
    t6 = Equation("P", left, right, tool).goal().pose(TICK)
    assert side(left, t6) == pytest.approx(side(right, t6))


def test_the_equation_of_the_first_paper_is_solved_as_printed_there() -> None:
    """T6 = REF^-1 CONV OBJ PG TOOL^-1."""
    t6 = Equation("P", [REF, T6, TOOL], [CONV, OBJ, PG], TOOL).goal().pose(TICK)
    assert t6 == pytest.approx(inverse(REF.value) @ CONV.value @ OBJ.value @ PG.value @ inverse(TOOL.value))


@pytest.mark.parametrize("wanted", [REF, TOOL, CONV, OBJ, PG])
def test_any_term_is_solved_for_from_a_measured_t6(wanted) -> None:
    left, right = [REF, T6, TOOL], [CONV, OBJ, PG]
    equation, t6 = Equation("P", left, right, TOOL), some_pose()
    found = Trsf(wanted.name, TransformKind.CONST, equation.solve(wanted, t6, TICK))
    left, right = ([found if one is wanted else one for one in terms] for terms in (left, right))
    assert side(left, t6) == pytest.approx(side(right, t6))


def controlled_frame(tool: Trsf, left, right, t6) -> np.ndarray:
    """Pose of the frame in which `tool` ends, seen from the start of the equation, for an arm at `t6`."""
    if tool in left or tool is T6:
        return side(left[: left.index(tool) + 1], t6)
    behind = right[right.index(tool) + 1 :]
    return side(left, t6) @ inverse(side(behind, t6))


@pytest.mark.parametrize("tool", [TOOL, PG, T6, CONV, OBJ])
def test_drive_moves_the_controlled_frame_along_its_line_on_either_side(tool) -> None:
    """The frame that TL names is at its goal times DRIVE: translation and turn in its own axes."""
    left, right = [REF, T6, TOOL, PG], [CONV, OBJ]
    goal = Equation("P", left, right, tool).goal()
    t6_goal = goal.pose(TICK)
    x = np.array([0.1, -0.2, 0.05, 0.3, -0.1, 0.2])
    t6 = goal.left.at(TICK) @ drive(x) @ goal.right.at(TICK)
    there, here = (controlled_frame(tool, left, right, pose) for pose in (t6_goal, t6))
    assert here == pytest.approx(there @ drive(x))


def test_an_offset_modifies_the_goal_in_the_controlled_frame_alone() -> None:
    equation = Equation("P", [T6, TOOL], [CONV, OBJ], TOOL)
    back = transform(translation=[0.0, 0.0, -0.01])
    near = equation.goal(back).pose(TICK) @ TOOL.value
    assert near == pytest.approx(CONV.value @ OBJ.value @ back)
    assert equation.goal().pose(TICK) @ TOOL.value == pytest.approx(CONV.value @ OBJ.value)


@pytest.mark.parametrize(
    ("left", "right", "tool", "words"),
    [
        ([TOOL], [OBJ], TOOL, "T6 must stand exactly once"),
        ([T6, T6], [OBJ], T6, "T6 must stand exactly once"),
        ([TOOL], [T6], TOOL, "T6 must stand exactly once, left of EQ"),
        ([REF, T6], [OBJ], REF, "the controlled frame REF must stand once, right of T6"),
        ([T6], [OBJ], TOOL, "the controlled frame TOOL must stand once"),
        ([T6], [OBJ, OBJ], OBJ, "the controlled frame OBJ must stand once"),
    ],
)
def test_an_equation_that_makes_no_sense_is_refused(left, right, tool, words) -> None:
    with pytest.raises(MotionError, match=words):
        Equation("P", left, right, tool)


@pytest.mark.parametrize("wanted", [T6, OBJ])
def test_what_cannot_be_solved_for_is_refused(wanted) -> None:
    with pytest.raises(MotionError, match="cannot be solved for"):
        Equation("P", [T6], [CONV, PG], T6).solve(wanted, np.eye(4), TICK)


def test_the_four_kinds_in_one_equation_count_each_at_its_own_time() -> None:
    calls: list[Trsf] = []
    const, hold, varb = term("C"), term("H", TransformKind.HOLD), term("V", TransformKind.VARB)
    func = Trsf("F", TransformKind.FUNCTION, function=calls.append)
    equation = Equation("P", [T6], [const, hold, varb, func], T6)
    goal, old_hold = equation.goal(), hold.value
    for one in (hold, varb):
        one.set(some_pose())
    func.value = some_pose()
    expected = const.value @ old_hold @ varb.value @ func.value
    assert goal.pose(TICK) == pytest.approx(expected)
    assert equation.goal().pose(TICK) == pytest.approx(const.value @ hold.value @ varb.value @ func.value)
    assert len(calls) == 1


def test_a_functional_transform_is_evaluated_once_a_sample_however_often_it_occurs() -> None:
    calls: list[Trsf] = []
    func = Trsf("F", TransformKind.FUNCTION, function=calls.append)
    goals = [Equation("P", [T6], [func, OBJ, func], T6).goal(), Equation("Q", [T6], [func], T6).goal()]
    for tick in (1, 1, 2, 3):
        for goal in goals:
            goal.pose(tick)
    assert len(calls) == 3


def test_constant_terms_are_multiplied_beforehand() -> None:
    func = Trsf("F", TransformKind.FUNCTION, function=lambda _: None)
    goal = Equation("P", [REF, T6, TOOL], [CONV, OBJ, func, PG], TOOL).goal()
    assert (len(goal.left), len(goal.right)) == (3, 1)  # REF^-1 CONV OBJ, F, PG; TOOL^-1
    assert not goal.fixed
    assert Equation("P", [REF, T6, TOOL], [CONV, OBJ, PG], TOOL).goal().fixed


def test_an_equation_is_released_with_its_terms() -> None:
    one = term("ONE")
    equation = Equation("P", [T6], [one], one)
    gone = [weakref.ref(one), weakref.ref(equation)]
    goal = equation.goal()
    del one, equation, goal
    gc.collect()
    assert [ref() for ref in gone] == [None, None]


def test_a_function_that_leaves_no_transform_is_told_by_name() -> None:
    def stretch(trsf: Trsf) -> None:
        trsf.value = trsf.value * 2.0

    with pytest.raises(MotionError, match="transform BAD: its function left no rigid transform"):
        Trsf("BAD", TransformKind.FUNCTION, function=stretch).at(1)


def test_a_value_that_is_no_transform_is_refused_and_the_old_one_kept() -> None:
    one = term("ONE")
    before = one.value
    with pytest.raises(MotionError, match="transform ONE: not a rigid transform"):
        one.set(np.ones((4, 4)))
    assert one.value is before


@pytest.mark.parametrize("kind", [TransformKind.CONST, TransformKind.HOLD, TransformKind.VARB])
def test_a_goal_of_a_transform_of_which_a_field_was_forgotten_is_refused(kind: TransformKind) -> None:
    half = Transform("HALF", kind)
    equation = Equation("P", [T6], [half], T6)
    half.n.x, half.n.y = np.cos(0.7), np.sin(0.7)
    with pytest.raises(MotionError, match="transform HALF: not a rigid transform"):
        equation.goal()
    half.o.x, half.o.y = -np.sin(0.7), np.cos(0.7)
    equation.goal()


@pytest.mark.parametrize(("kind", "function"), [(TransformKind.FUNCTION, None), (TransformKind.VARB, lambda _: None)])
def test_a_function_belongs_to_functional_transforms_only(kind, function) -> None:
    with pytest.raises(MotionError, match="a function belongs to"):
        Trsf("T", kind, function=function)


def test_the_frame_of_an_object_is_the_unknown_of_its_own_equations() -> None:
    """Multi-RCCL: TRANS GRASP = CONV PG, solved for where the object has to be while the belt runs."""
    trans, grasp = Trsf("TRANS", TransformKind.UNKNOWN), Trsf("GRASP", TransformKind.CONST, some_pose())
    equation = Equation("OBJECT", [trans, grasp], [CONV, PG], grasp, unknown=trans)
    goal = equation.goal()
    assert goal.pose(TICK) @ grasp.value == pytest.approx(CONV.at(TICK) @ PG.value)
    x = np.array([0.1, 0.0, -0.2, 0.3, 0.0, 0.1])
    on_the_way = goal.left.at(TICK) @ drive(x) @ goal.right.at(TICK)
    assert on_the_way @ grasp.value == pytest.approx(CONV.at(TICK) @ PG.value @ drive(x))
    assert equation.solve(PG, goal.pose(TICK), TICK) == pytest.approx(PG.value)
    with pytest.raises(MotionError, match="TRANS must stand exactly once"):
        Equation("OBJECT", [grasp], [CONV, PG], grasp, unknown=trans)


def test_an_equation_shows_as_it_is_written() -> None:
    assert repr(Equation("P", [REF, T6, TOOL], [CONV, OBJ], TOOL)) == "REF T6 TOOL = CONV OBJ (TL TOOL)"


def test_drive_is_a_line_and_a_turn_about_a_fixed_axis_linear_in_s() -> None:
    x = np.array([0.3, -0.2, 0.1, 0.4, 0.8, -0.5])
    for s in np.linspace(0.0, 1.0, 5):
        D = drive((1.0 - s) * x)
        assert D[:3, 3] == pytest.approx((1.0 - s) * x[:3])
        assert D[:3, :3] @ x[3:] == pytest.approx(x[3:])
    assert drive(0.0 * x) == pytest.approx(np.eye(4))


def test_a_turn_that_passes_half_a_circle_is_read_on_from_the_turn_before() -> None:
    before = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi - 0.01])
    after = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi + 0.01])
    assert drive_parameters(drive(after), before) == pytest.approx(after)
    assert drive_parameters(drive(after))[5] == pytest.approx(0.01 - np.pi)


@pytest.mark.parametrize(
    "spoil", [(0, 3, np.nan), (1, 3, np.inf), (0, 0, np.nan), (1, 2, 0.1), (3, 3, 2.0), (3, 1, 0.1)]
)
def test_the_fast_check_of_every_sample_agrees_with_the_thorough_one(spoil) -> None:
    row, column, number = spoil
    good = some_pose()
    bad = good.copy()
    bad[row, column] = number
    mirrored = good @ np.diag([1.0, 1.0, -1.0, 1.0])
    assert [rigid(T) for T in (good, bad, mirrored)] == [is_transform(T) for T in (good, bad, mirrored)]
    assert [rigid(T) for T in (good, bad, mirrored)] == [True, False, False]


@pytest.mark.parametrize("turn", list(OrientationInterpolation))
@pytest.mark.parametrize("axis", np.eye(3))
def test_half_turns_that_rounding_tells_apart_go_one_way(axis: np.ndarray, turn: OrientationInterpolation) -> None:
    half_turns = [transform(so3_exp((np.pi + noise) * axis)) for noise in (-1e-12, 0.0, 1e-12)]
    found = [drive_parameters(D, turn=turn) for D in half_turns]
    assert np.array(found) == pytest.approx(np.array([found[0]] * 3), abs=1e-6)
    for D, x in zip(half_turns, found, strict=True):
        assert drive(x, turn) == pytest.approx(D, abs=1e-9)
        assert drive_parameters(D, -1.1 * x, turn) == pytest.approx(-x, abs=1e-9)
