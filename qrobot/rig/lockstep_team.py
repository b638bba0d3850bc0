"""Arms in lock-step whose physics is one, such as two with a body in both hands: their time passes together.

One plant step of each arm follows on that of the other. What programs command in a sample therefore acts when all have
said it, which is a sample later, as over a link that takes one: for all arms alike, so that no hand goes ahead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

from qrobot.errors import ConfigError
from qrobot.rccl_bridge.actions import Action, Forward, SessionOutcome
from qrobot.rccl_bridge.servo_interface import SetpointFrame
from qrobot.rci import VirtualLink
from qrobot.rig.lockstep import LockstepBridge, LockstepRig
from qrobot.sim_board.emulator import emulator_run
from qrobot.wire import Hello


class LockstepTeam:
    """Rigs whose time passes together.

    Args:
        rigs: in the order in which the arms take their plant steps.
        look: called after each servo cycle of all.

    Attributes:
        rigs: as given.

    Raises:
        ConfigError: their periods differ.
    """

    def __init__(self, rigs: Sequence[LockstepRig], look: Callable[[], object] = lambda: None) -> None:
        self.rigs = tuple(rigs)
        if len({(rig.period_ns, rig.substeps, rig.now_ns) for rig in rigs}) != 1:
            raise ConfigError("arms that share their physics need servos and plants of the same periods")
        self._look = look
        self._posts: list[Callable[[], object]] = []

    def link(self, rig: LockstepRig, period_us: int, hello: Hello) -> VirtualLink:
        """A program's way to one of the rigs, as `link_factory`."""
        return VirtualLink(hello, _TeamBridge(self, rig, period_us).transfer)

    def post(self, deed: Callable[[], object]) -> None:
        """Do this when time passes again."""
        self._posts.append(deed)

    def ticks(self, n: int) -> None:
        """Advance all by `n` servo cycles."""
        if n > 0:
            posts, self._posts = self._posts, []
            for deed in posts:
                deed()
        for _ in range(n):
            self._cycle()

    def _cycle(self) -> None:
        for rig in self.rigs:
            rig.compute()
        for _ in range(self.rigs[0].substeps):
            for rig in self.rigs:
                rig.now_ns = emulator_run(rig.emulator.bundle, rig.board, rig.now_ns, 1)
        for rig in self.rigs:
            rig.keep()
        self._look()


class _TeamBridge(LockstepBridge):
    """The bridge of one arm of a team."""

    def __init__(self, team: LockstepTeam, rig: LockstepRig, period_us: int) -> None:
        super().__init__(rig, period_us)
        self._team = team
        self._frames: list[SetpointFrame] = []

    def transfer(self, data: bytes) -> bytes:
        """See `LockstepBridge.transfer`: setpoints wait until time passes again."""
        answer = super().transfer(data)
        for frame in self._frames:
            self._team.post(partial(self._forward, frame))
        self._frames.clear()
        return answer

    def _forward(self, frame: SetpointFrame) -> None:
        self._port.write_setpoint(replace(frame, t_ns=self._rig.now_ns))

    def _carry_out(self, actions: Iterable[Action]) -> SessionOutcome:
        told = list(actions)
        self._frames += [action.frame for action in told if isinstance(action, Forward)]
        return super()._carry_out(action for action in told if not isinstance(action, Forward))

    def _pass(self, cycles: int) -> None:
        if not self._session.ended:  # a program that has left does not hold up the others
            self._team.ticks(cycles)
