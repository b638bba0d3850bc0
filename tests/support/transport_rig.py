"""The lock-step rig with a transport between servo and board: the same virtual time, every register word over a bus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from qrobot.config import Robot
from qrobot.errors import LinkError
from qrobot.hwif.bus import Bus, Endpoint, Operations
from qrobot.hwif.gateway import Gateway
from qrobot.rig.lockstep import START_NS, LockstepRig, run_blocks
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator, emulator_run
from tests.support.bus import DirectBus
from tests.support.stepping_endpoint import SteppingEndpoint


class TransportRig(LockstepRig):
    """A servo, a gateway, a bus and an emulated board that steps when the bus brings it operations.

    One exchange a servo cycle: what a cycle writes acts from its own instant on and the next one sees the image of its
    own, exactly as without a transport, when the transport carries the board's time stamps.

    Args:
        robot, settings, emulator: as of `LockstepRig`.
        open_bus: builds the transport to an endpoint; the near end is returned. The caller tears it down.

    Attributes:
        gateway: to be cut and looked at.
        end: the far end, with the emulator's own board memory.

    Raises:
        ConfigError: the servo's period is no multiple of the plant's.
        LinkError: the gateway finds no board over that transport.
    """

    def __init__(
        self,
        robot: Robot,
        settings: ServoSettings,
        open_bus: Callable[[Endpoint], Bus],
        emulator: Emulator | None = None,
        keep_telemetry: bool = True,
    ) -> None:
        super().__init__(robot, settings, emulator, keep_telemetry)
        self.end = SteppingEndpoint(self.emulator, 0, START_NS)  # no time passes until the servo's first cycle
        self.lines: list[str] = []
        self.gateway = Gateway(open_bus(self.end), self.board, self.period_ns, self.lines.append)
        if not self.gateway.step(self.now_ns):
            raise LinkError("; ".join(self.lines))
        self.end.steps = self.substeps

    def ticks(self, n: int) -> None:
        """Advance by `n` servo cycles, each with one exchange; a transport that is cut costs no virtual time of the
        arm."""
        for _ in range(n):
            run_blocks(*self.loop_arguments, self.now_ns, 1, 0)
            self.gateway.step(self.now_ns)
            self.now_ns += self.period_ns
            self.keep()


class RareEndpoint(SteppingEndpoint):
    """Lets the time since the exchange before pass, and applies the operations then.

    Its image, and the count in it, is that of the present instant, which shows nothing yet of what was applied there.
    """

    def apply(self, operations: Operations) -> None:
        """Move on to the present instant, and apply them there."""
        self.now_ns = emulator_run(self.emulator.bundle, self.memory, self.now_ns, self.steps)
        self._board.apply(operations)


class RareRig(LockstepRig):
    """A servo behind a board that is asked once in so many of its cycles, as one on a slow bus is.

    Args:
        robot, settings, emulator: as of `LockstepRig`.
        cycles: of the servo, to each exchange.
        lasts: cycles of the servo in which an exchange is under way; `cycles` at most.

    Attributes:
        end: the far end, with the emulator's own board memory.
    """

    def __init__(
        self,
        robot: Robot,
        settings: ServoSettings,
        emulator: Emulator,
        cycles: int,
        keep_telemetry: bool = True,
        lasts: int = 0,
    ) -> None:
        settings = replace(settings, exchange_ms=cycles * settings.period_ns * 1e-6)
        super().__init__(robot, settings, emulator, keep_telemetry)
        self.end = RareEndpoint(self.emulator, 0, START_NS)
        bus = DirectBus(self.end)
        self.gateway = Gateway(bus, self.board, cycles * self.period_ns, lambda _line: None)
        assert self.gateway.step(self.now_ns)
        bus.spoil = lambda _image: self._go_on(lasts)  # the image is on its way
        self.end.steps = cycles * self.substeps
        self._cycles, self._lasts, self._done, self._wanted = cycles, lasts, 0, 0

    def ticks(self, n: int) -> None:
        """Advance by `n` servo cycles; some of them may have passed with an exchange already."""
        self._wanted += n
        while self._done < self._wanted:
            if self._lasts < self._cycles:
                self._go_on(1)
            if self._done % self._cycles == 0:
                self.gateway.step(self.now_ns)

    def _go_on(self, n: int) -> None:
        for _ in range(n):
            run_blocks(*self.loop_arguments, self.now_ns, 1, 0)
            self.now_ns += self.period_ns
            self._done += 1
            self.keep()
