"""Programs before a robot that follows perfectly, and positions on a table under its tool."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, t6, yunit
from qrobot.rci import VirtualLink
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK, shift
from tests.support.puma import arm as puma

TIP = shift(z=0.1).value
E = gentr_trsl("E", 0, 0, 100)
TABLE = gentr_rot("TABLE", 500, 50, -300, yunit, 180)


@contextmanager
def programmed() -> Iterator[FakeRobot]:
    """A robot that a program has taken, in Cartesian mode."""
    fake = FakeRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)):
        rccl.control()
        rccl.setvel(200, 90)
        rccl.setmode("cartesian")
        yield fake
        rccl.release()


def on_table(name: str, *terms: object) -> rccl.Position:
    """`t6 E = TABLE terms E`: the tool's tip there, upside down."""
    return makeposition(name, t6, E, EQ, TABLE, *terms, TL, E)


def turning_from_park() -> tuple[rccl.Transform, rccl.Transform]:
    """The pose at park, behind a turn that grows by a degree at each look: in the end some joint comes to its limit."""
    turned = [0.0]

    def turn(t: rccl.Transform) -> None:
        turned[0] += 1.0
        rccl.rot(t, rccl.zunit, turned[0])

    here = rccl.newtrans("HERE", "const")
    here.set(puma().forward(PARK))
    return rccl.newtrans("TURN", turn), here
