"""RCCL's transforms in millimetres and degrees, and `makeposition`."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import MotionError
from qrobot.model.transform import rot_x, rot_y, rot_z, transform
from qrobot.rccl import (
    EQ,
    TL,
    assigntr,
    const,
    gentr_eul,
    gentr_pao,
    gentr_rot,
    gentr_rpy,
    gentr_trsl,
    hold,
    invert,
    makeposition,
    newtrans,
    rot,
    t6,
    trmult,
    trsl,
    varb,
    xunit,
    yunit,
    zunit,
)

P = 10.0, 20.0, 30.0
ASKEW = np.array((0.1, 0.2, 0.3))
HALF = np.radians(30.0)


@pytest.mark.parametrize(
    ("made", "rotation"),
    [
        (gentr_trsl("T", *P), np.eye(3)),
        (gentr_rot("T", *P, zunit, 30.0), rot_z(HALF)),
        (gentr_rot("T", *P, (0.0, 5.0, 0.0), 30.0), rot_y(HALF)),
        (gentr_eul("T", *P, 30.0, 60.0, 90.0), rot_z(HALF) @ rot_y(2 * HALF) @ rot_z(3 * HALF)),
        (gentr_rpy("T", *P, 30.0, 60.0, 90.0), rot_z(HALF) @ rot_y(2 * HALF) @ rot_x(3 * HALF)),
        (gentr_pao("T", P, (0.0, 0.0, -2.0), (0.0, 1.0, 0.5)), np.diag([-1.0, 1.0, -1.0])),
    ],
)
def test_constructors_take_millimetres_and_degrees(made, rotation) -> None:
    assert made.value == pytest.approx(transform(rotation, [0.01, 0.02, 0.03]))
    assert (made.p.x, made.p.y, made.p.z) == pytest.approx(P)


@pytest.mark.parametrize("kind", [const, varb, hold])
def test_a_new_transform_is_an_identity_of_its_kind(kind) -> None:
    made = newtrans("T", kind)
    assert (made.value == np.eye(4)).all()
    assert (made.name, made.kind.value) == ("T", kind)


def test_a_new_transform_with_a_function_is_functional() -> None:
    """The proximity sensor of Hayward & Paul 1986, section 3.4.1: t->p.z += (sensor - OFFSET) * gain."""

    def sensfn(t: rccl.Transform) -> None:
        t.p.z += 0.5

    sens = newtrans("SENS", sensfn)
    assert [sens.at(tick)[2, 3] for tick in (1, 2, 2, 3)] == pytest.approx([5e-4, 1e-3, 1e-3, 1.5e-3])


def test_columns_are_n_o_a_and_p_and_are_written_in_place() -> None:
    t = gentr_rot("T", *P, xunit, 90.0)
    assert [*t.n] == pytest.approx([1.0, 0.0, 0.0])
    assert [*t.o] == pytest.approx([0.0, 0.0, 1.0])
    assert [*t.a] == pytest.approx([0.0, -1.0, 0.0])
    t.p.x, t.p.y, t.p.z = 1.0, 2.0, 3.0
    assert t.value[:3, 3] == pytest.approx([0.001, 0.002, 0.003])


def test_functions_change_a_transform_and_return_it() -> None:
    a, b, c = newtrans("A"), gentr_trsl("B", *P), newtrans("C")
    assert rot(a, zunit, 90.0) is a
    assert a.value[:3, :3] == pytest.approx(rot_z(np.pi / 2))
    assert trmult(c, a, b) is c
    assert [*c.p] == pytest.approx([-20.0, 10.0, 30.0])
    assert trmult(c, invert(newtrans("I"), c), assigntr(newtrans("D"), c)).value == pytest.approx(np.eye(4))
    assert [*trsl(a, 1.0, 2.0, 3.0).p] == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("deed", "words"),
    [
        (lambda: newtrans("T", "constant"), "transform T: kind 'constant' is none of"),
        (lambda: gentr_rot("T", 0, 0, 0, (0, 0, 0), 1.0), "needs a direction"),
        (lambda: gentr_pao("T", P, zunit, zunit), "must not be parallel"),
        *((lambda o=o: gentr_pao("T", P, ASKEW, o * ASKEW), "must not be parallel") for o in (3.0, 0.7, -1.3)),
        (lambda: makeposition("P", t6, EQ, gentr_trsl("B", *P)), "makeposition: write"),
        (lambda: makeposition("P", t6, TL, t6), "makeposition: write"),
        (lambda: makeposition("P", t6, EQ, TL, t6, t6), "makeposition: write"),
        (lambda: makeposition("P", EQ, t6, TL, t6), "T6 must stand exactly once, left of EQ"),
    ],
)
def test_nonsense_is_refused_with_a_hint(deed, words) -> None:
    with pytest.raises(MotionError, match=words):
        deed()


def test_makeposition_reads_like_the_equation() -> None:
    """The equation of Hayward & Paul 1986, section 3.1: R T6 E = C O."""
    r, e, c, o = (gentr_trsl(name, *P) for name in ("R", "E", "C", "O"))
    p = makeposition("P", r, t6, e, EQ, c, o, TL, e)
    assert repr(p) == "Position('P', R T6 E = C O (TL E))"
    assert (p.name, p.code, p.scal, p.end.count) == ("P", 0, 0.0, 0)
    with pytest.raises(MotionError, match="position P is not given by its joints"):
        _ = p.q
    assert p.equation.goal().pose(1) == pytest.approx(np.eye(4))


def test_a_users_own_constructor_is_an_ordinary_function() -> None:
    """B-31."""

    def gentr_on_circle(name: str, radius: float, angle: float) -> rccl.Transform:
        return trmult(newtrans(name), gentr_rot("", 0, 0, 0, zunit, angle), gentr_trsl("", radius, 0, 0))

    assert [*gentr_on_circle("C", 50.0, 90.0).p] == pytest.approx([0.0, 50.0, 0.0])
    assert yunit == (0.0, 1.0, 0.0)
