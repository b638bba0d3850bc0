"""Calls of a program about what its arm does beside its motions: hand, outputs, log, payload, collisions."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Final

from qrobot.config import Robot
from qrobot.errors import MotionError
from qrobot.rccl.arm_session import ArmSession
from qrobot.rccl.task import TrajectoryTask
from qrobot.rci.arguments import collision_of, numbers, payload_of, require_torques, retract_m, shown
from qrobot.wire.packets import analog_output
from qrobot.wire.vocabulary import N_ANALOG_OUTPUTS, Hand

RETRACT: Final = "retract"


class HandAndOutputs:
    """The calls about hand, outputs, log, payload and collisions; `Channel` inherits them."""

    robot: Robot
    _task: TrajectoryTask
    _session: ArmSession
    _told_kg: float = 0.0  # by `setload`

    def OPEN(self) -> None:  # noqa: N802 (RCCL's name)
        """Open the hand, now."""
        self._set_hand(Hand.OPEN)

    def CLOSE(self) -> None:  # noqa: N802 (RCCL's name)
        """Close the hand, now."""
        self._set_hand(Hand.CLOSED)

    def signal(self, *lines: int) -> None:
        """Switch binary outputs, now: `signal(3, -4)` switches output 3 on and output 4 off. Named after VAL's.

        Raises:
            MotionError: there is no such output; none is switched.
        """
        with self._session.task():
            self._task.chg.signal(*lines)

    def analog(self, output: int, volts: float) -> None:
        """Let an analogue output of the deployment file, from 1, show `volts`. Waits for some samples.

        Raises:
            MotionError: there is no such output, or it does not show so much; nothing has changed then.
        """
        if isinstance(output, bool) or output not in range(1, N_ANALOG_OUTPUTS + 1):
            raise MotionError(f"analog({shown(output)}): analogue outputs are 1 to {N_ANALOG_OUTPUTS}")
        (asked,) = numbers("analog", volts)
        self._session.settings.tell(analog_output(output, asked))

    def log_signal(self, name: str, value: float) -> None:
        """Tell a number of this program's own, which goes into the arm's log in each cycle from the next sample on.

        Up to eight names, of letters, digits and underscores. NaN stands for none.

        Raises:
            MotionError: no such name can be, or it would be the ninth; or the value is no number.
        """
        (number,) = (value,) if isinstance(value, float) and isnan(value) else numbers("log_signal", value)
        self._session.log_signal(name, number)

    def setload(
        self, kg: float, centre: Sequence[float] = (0.0, 0.0, 0.0), inertia: Sequence[float] = (0.0,) * 6
    ) -> None:
        """Tell the servo what the hand holds: mass, and centre of mass in the frame of the flange, mm.

        Waits half a second, until the servo reckons with it; the arm may be moving meanwhile. A load stays when the
        program ends: `setload(0)` takes it away.

        Args:
            kg: mass. centre: mm. Shape (3,).
            inertia: about the centre along the axes of the flange, kg m^2: xx yy zz xy xz yz. Shape (6,).

        Raises:
            MotionError: the arm cannot carry it, or that is no load; nothing has changed then.
        """
        load = payload_of("setload", kg, centre, inertia)
        told_kg, self._told_kg = self._told_kg, max(self._told_kg, load.mass)  # the servo goes over to it meanwhile
        try:
            self._session.settings.tell(load)
        except BaseException:
            self._told_kg = told_kg
            raise
        with self._session.task():
            self._task.carry(load)
        self._told_kg = load.mass

    def collision(self, reaction: str = "stop", thresholds: Sequence[float] | None = None, mm: float = 20.0) -> None:
        """Choose what follows a collision, and have collisions told sooner than the robot file does.

        After each the servo stops the arm, which gives way to what it has met; then it is held ("stop"), is soft for
        two seconds before it is held ("comply"), or goes back by `mm` of its flange along the path just travelled
        ("retract"). Waits for some samples. Counts until the program lets go of the arm.

        Args:
            reaction: "stop", "comply" or "retract".
            thresholds: torque that nobody commanded, N m (N); None for the robot file's, which none may exceed. What
                accelerations may hide comes on top, so low ones count for slow motions. Shape (n,).
            mm: of the way back, 0 to 300.

        Raises:
            MotionError: no such reaction or distance, or thresholds that the arm does not take, as one whose torques
                nobody knows takes none; nothing has changed.
        """
        back_m = retract_m("collision", mm) if reaction == RETRACT else 0.0
        after = "stop" if reaction == RETRACT else reaction
        if back_m:
            self._require_torques("collision")
        self._session.settings.tell(collision_of("collision", self.robot, after, thresholds, RETRACT))
        self._task.retract_m = back_m

    def retract(self, mm: float) -> None:
        """Let the arm go back after a collision, by `mm` of its flange along the path just travelled; 0: stay there.

        When the servo has stopped the arm for COLLISION and holds it, the arm goes back slowly (100 mm/s at most), and
        comes to rest; then the program is told ServoFault, or its path is kept. It goes back once: what it meets
        on the way ends that. The path is remembered from this call on.

        In a program of several arms the others stand still on their paths meanwhile. While one of them goes to a goal
        that moves, or stays with one, no arm goes back: two may hold one thing. `stop`, and a pause of the program or
        the operator, let the arm come to rest on its way, and end that.

        Raises:
            MotionError: no such distance; or nobody knows the arm's torques, which alone tell a collision.
        """
        back_m = retract_m("retract", mm)
        if back_m:
            self._require_torques("retract")
        self._task.retract_m = back_m

    def _require_torques(self, call: str) -> None:
        """Raise MotionError for a call that acts by the torques of an arm that tells none: the newest sample tells."""
        if self._task.how is not None:
            require_torques(call, self._task.how.torques_known)

    def _require_forces(self, call: str) -> None:
        """See `MotionParameters`. Of a load that others have told a program hears the mass, and no centre.

        The servo may carry less than this program has told: it goes over to that, or has started anew.
        """
        self._require_torques(call)
        how = self._task.how
        if how is not None and how.payload_mass > self._told_kg:
            raise MotionError(
                f"{call}: the arm carries {how.payload_mass:g} kg, and this program has told {self._told_kg:g}: "
                "the rest would count as force. Tell what the hand holds by `setload`"
            )

    def _set_hand(self, hand: Hand) -> None:
        with self._session.task():
            self._task.chg.hand = hand
