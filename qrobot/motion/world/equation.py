"""Position equations: closed chains of transforms, `L1 ... T6 ... Lk = R1 ... Rm` (Hayward & Paul 1986, section 2.2).

Written as one loop, L1 ... T6 ... Lk Rm^-1 ... R1^-1 = I, an equation is solved for any of its terms by cutting the
loop there: with A before the term and B behind it, its inverse is B A.

A motion inserts DRIVE to the right of the controlled frame, the one that TL names: T6 = (R P) DRIVE E. What stands left
of DRIVE is called `left` here, what stands right of it `right`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.transform import inverse
from qrobot.motion.world.compliance import Compliance
from qrobot.motion.world.product import Factor, Product, inverted
from qrobot.motion.world.trsf import T6, Trsf


class Equation:
    """A position equation. It holds references to its terms and to nothing else: released when nobody names it.

    Args:
        name: for traces and messages.
        left, right: the terms on either side; the unknown stands once on the left.
        tool: the term that ends in the controlled frame; it must not lie between the unknown and the base.
        unknown: T6, or that of another mover.

    Raises:
        MotionError: the unknown does not stand exactly once on the left, the tool is not a term or does not move
            with the arm, or a side is empty.
    """

    def __init__(self, name: str, left: Sequence[Trsf], right: Sequence[Trsf], tool: Trsf, unknown: Trsf = T6) -> None:
        self.name = name
        self.left, self.right = tuple(left), tuple(right)
        self.tool, self.unknown = tool, unknown
        if self.left.count(unknown) != 1 or unknown in self.right:
            raise MotionError(f"position {name}: {unknown.name} must stand exactly once, left of EQ")
        self._loop = [Factor(term) for term in self.left] + inverted([Factor(term) for term in self.right])
        self._split = self._split_at(tool)

    @property
    def terms(self) -> tuple[Trsf, ...]:
        """All terms, as written."""
        return self.left + self.right

    def goal(self, offset: Floats | None = None, compliance: Compliance | None = None) -> Goal:
        """Make the goal that a motion takes along: values of constant and hold terms as they are now.

        Args:
            offset: a small motion of the controlled frame that modifies the goal (A-10). Shape (4, 4).
            compliance: how the arm gives way during the motion and after it.
        """
        chain = self._chain(self.unknown)
        left: list[Factor | Floats] = [*chain[: self._split]]
        left = left if offset is None else [*left, offset]
        return Goal(self.name, Product(left), Product(chain[self._split :]), self, compliance)

    def solve(self, term: Trsf, t6: Floats, tick: int) -> Floats:
        """The value of `term` that makes the equation true with T6 at `t6`, all others as at sample `tick`.

        Shapes (4, 4).

        Raises:
            MotionError: the term does not stand exactly once in the equation, or is T6 itself.
        """
        if term is self.unknown or self.terms.count(term) != 1:
            raise MotionError(f"position {self.name}: cannot be solved for {term.name}, which must stand in it once")
        value = np.eye(4)
        for factor in self._chain(term):
            if factor.trsf is self.unknown:
                value = value @ (inverse(t6) if factor.inverted else t6)
            else:
                value = value @ factor.at(tick)
        return value

    def _chain(self, term: Trsf) -> list[Factor]:
        """The factors whose product is `term`."""
        at = next(i for i, factor in enumerate(self._loop) if factor.trsf is term)
        rest = self._loop[at + 1 :] + self._loop[:at]
        return rest if self._loop[at].inverted else inverted(rest)

    def _split_at(self, tool: Trsf) -> int:
        """Number of factors of T6's chain left of DRIVE."""
        chain = self._chain(self.unknown)
        if tool is self.unknown:
            return len(chain)
        behind = self.left[self.left.index(self.unknown) + 1 :]
        places = [i for i, factor in enumerate(chain) if factor.trsf is tool]
        if len(places) != 1 or tool not in behind + self.right:
            where = f"stand once, right of {self.unknown.name}, or on the other side"
            if len(places) > 1:
                where += "; give its other place a transform of its own with the same value"
            raise MotionError(f"position {self.name}: the controlled frame {tool.name} must {where}")
        return places[0] if chain[places[0]].inverted else places[0] + 1

    def __repr__(self) -> str:
        left, right = (" ".join(term.name for term in side) for side in (self.left, self.right))
        return f"{left} = {right} (TL {self.tool.name})"


class Goal:
    """Goal of a motion: T6 = left COMPLY right, and during the motion T6 = left DRIVE COMPLY right.

    Attributes:
        name: of the position.
        left, right: the two products.
        equation: it came from.
        compliance: how the arm gives way; without it COMPLY is not there.
        fixed: it stands still.
    """

    def __init__(
        self,
        name: str,
        left: Product,
        right: Product,
        equation: Equation | None = None,
        compliance: Compliance | None = None,
    ) -> None:
        self.name = name
        self.left, self.right = left, right
        self.equation = equation
        self.compliance = compliance
        self.fixed = left.fixed and right.fixed and compliance is None

    @property
    def moving(self) -> list[Trsf]:
        """The variable and functional transforms of both products."""
        return self.left.moving + self.right.moving

    def pose(self, tick: int) -> Floats:
        """T6 at the goal, at sample `tick`. Shape (4, 4)."""
        return self.left.at(tick) @ self.carried(tick)

    def tool(self, tick: int) -> Floats:
        """T6 in the controlled frame. Shape (4, 4)."""
        return self.right.at(tick)

    def carried(self, tick: int) -> Floats:
        """Product right of DRIVE: COMPLY and `right`. Shape (4, 4)."""
        right = self.right.at(tick)
        return right if self.compliance is None else self.compliance.transform.at(tick) @ right
