"""Study of gains for all arms of a kind: each arm tries every pair of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import ClassVar, Final

from qrobot.config import Robot
from qrobot.errors import ConfigError, ServoFault
from qrobot.faultcodes import explain
from qrobot.rig.perturbed_arm import PerturbedArm
from qrobot.servo.kernels.velocity import DEFAULT_ESTIMATOR, find_estimator
from qrobot.servo.laws.file import law_digest
from qrobot.servo.laws.names import DEFAULT_LAW, check_law_name, is_file_law
from qrobot.servo.settings import ServoSettings
from qrobot.study.study import ArmResult, Study, kept
from qrobot.study.tracking_run import track_experiment

BANDWIDTHS: Final = (0.5, 0.7, 1.0, 1.4, 2.0)
DAMPINGS: Final = (0.5, 1.0)


@dataclass(frozen=True)
class GainStudy(Study):
    """The paper's experiment on each arm with every pair of gains, the robot file believed.

    Attributes:
        law, velocity: of the servo.
        bandwidths: factors f on the natural frequency: Kp grows by f², Kv by f.
        dampings: factors on the damping, and so on Kv, beside.
    """

    kind: ClassVar[str] = "gains"
    law: str = DEFAULT_LAW
    velocity: str = DEFAULT_ESTIMATOR
    bandwidths: tuple[float, ...] = BANDWIDTHS
    dampings: tuple[float, ...] = DAMPINGS

    def __post_init__(self) -> None:
        super().__post_init__()
        check_law_name(self.law)
        find_estimator(self.velocity)
        if not (self.bandwidths and self.dampings and min(*self.bandwidths, *self.dampings) > 0.0):
            raise ConfigError(f"bandwidths {self.bandwidths} and dampings {self.dampings}: factors above 0 are wanted")

    @property
    def terms(self) -> ArmResult:
        """Parameters of every study; a law in a file counts by its text, not by its name alone. Raises ConfigError."""
        return super().terms | ({"law_text": law_digest(self.law)[:16]} if is_file_law(self.law) else {})

    def judge(self, seed: int) -> ArmResult:
        """Try each pair on one arm.

        Returns:
            tried: of each pair `rms` and `largest` error, as shares of what the guard allows, and `chatter`, all of the
                worst joint; or `fault`, the reason why the servo stopped the arm.
        """
        arm = PerturbedArm.drawn(self.robot, seed, wrong_torque=True)
        pairs = product(self.dampings, self.bandwidths)
        return {
            "payload_kg": kept(arm.payload_kg),
            "tried": [
                {"bandwidth": f, "damping": d, **self._tried(with_gains(self.robot, f, d), arm)} for d, f in pairs
            ],
        }

    def _tried(self, believed: Robot, arm: PerturbedArm) -> ArmResult:
        settings = ServoSettings(rate_hz=self.rate_hz, law=self.law, velocity=self.velocity)
        try:
            tracked = track_experiment(believed, self.robot_file, settings, arm.emulator())
        except ServoFault as fault:
            return {"fault": explain(fault.code).partition(":")[0]}
        allowed = self.robot.guard.following_error
        shares = {"rms": tracked.rms / allowed, "largest": tracked.largest / allowed, "chatter": tracked.chatter}
        return {name: kept(share.max()) for name, share in shares.items()}


def with_gains(robot: Robot, bandwidth: float, damping: float) -> Robot:
    """The robot with its natural frequencies and dampings multiplied: Kp by f², Kv by f and by the damping's factor."""
    control = robot.control
    gains = {"kp": control.kp * bandwidth**2, "kv": control.kv * bandwidth * damping}
    return robot.model_copy(update={"control": control.model_copy(update=gains)})
