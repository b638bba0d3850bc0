"""Load and collisions as programs of ARCL, in Python and C, and of VAL II tell them to the servo, in lock-step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.arcl import arcl_close, arcl_collision, arcl_open, arcl_setload, arcl_wait
from qrobot.cli.arms import choose_arm
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.servo_settings import servo_settings
from qrobot.errors import MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.hwif.registers import DAC_COUNTS_PER_VOLT, DAC_ZERO
from qrobot.rccl.c.program import run_executable
from qrobot.rci.machine_choice import MachineChoice, use_machine
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.val.interpreter import Interpreter
from qrobot.val.monitor import ValMonitor
from tests.support.arcl import forget_programs, run_c
from tests.support.c_programs import compiled, compiled_text, needs_compiler
from tests.support.dead_encoder import TABLE
from tests.support.puma import ROBOT
from tests.support.val_storms import arm_in_lockstep

EXAMPLES = Path(__file__).parents[2] / "examples"
ELBOW = 2
THRESHOLDS = ROBOT.guard.unexplained_torque_or_default
PUSH_MICRO = int(0.75e6 * THRESHOLDS[ELBOW])
HEAVY = "carries 2.5 kg"


@pytest.fixture
def rig() -> LockstepRig:
    emulator = Emulator(ROBOT, physics="rigid", start="ready")
    return LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0, calibration=TABLE), emulator, keep_telemetry=False)


@contextmanager
def arcl_on(rig: LockstepRig) -> Iterator[None]:
    forget_programs()
    try:
        with use_machine(MachineChoice("bridge", None, ROBOT)), rci.use(partial(link_factory, rig, 28_000)):
            yield
    finally:
        forget_programs()


def pushed(rig: LockstepRig, sample: Callable[[], object]) -> None:
    """Push the elbow for half a second by three quarters of the robot file's threshold."""
    rig.board.panel.push[ELBOW] = PUSH_MICRO
    for _ in range(18):
        sample()
    rig.board.panel.push[ELBOW] = 0


def test_a_program_in_arcl_tells_its_load_and_what_the_arm_cannot_carry_changes_nothing(rig: LockstepRig) -> None:
    with arcl_on(rig):
        rp = arcl_open(0)
        arcl_setload(rp, 2.0, (0.0, 0.0, 50.0), (0.001, 0.001, 0.001, 0.0, 0.0, 0.0))
        assert rig.mailbox.snapshot().payload_mass == 2.0
        for told, why in (
            ((5.0,), HEAVY),
            ((2.4, (0, 0, 900)), "would have to hold"),
            ((-1.0,), "cannot carry that"),
            ((np.nan,), "setload: nan is not a finite number"),
            ((1.0, (0, 0)), "a centre has 3 numbers"),
            ((1.0, None, (1.0,)), "an inertia 6"),
        ):
            with pytest.raises(MotionError, match=why):
                arcl_setload(rp, *told)
        assert rig.mailbox.snapshot().payload_mass == 2.0
        arcl_setload(rp, 0)
        arcl_close(rp)
    assert rig.mailbox.snapshot().payload_mass == 0.0


def test_a_program_in_arcl_has_a_collision_told_sooner(rig: LockstepRig) -> None:
    with arcl_on(rig):
        rp = arcl_open(0)

        def sample() -> None:
            before = rp.ami.sample
            arcl_wait(rp, lambda: rp.ami.sample is not before)

        pushed(rig, sample)
        for told, why in (
            (("bounce",), "'bounce' is none of stop, comply"),
            (("stop", [1.0]), "1 thresholds for 6 joints"),
            (("stop", [1e6] * 6), "collisions can only be told sooner"),
            (("stop", [0.0] * 6), "a threshold is a torque above 0"),
        ):
            with pytest.raises(MotionError, match=why):
                arcl_collision(rp, *told)
        pushed(rig, sample)
        arcl_collision(rp, "comply", (0.5 * THRESHOLDS).tolist())
        with pytest.raises(ServoFault) as told_of:
            pushed(rig, sample)
        assert told_of.value.code == FaultCode.COLLISION


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_a_program_in_val_tells_its_load_and_has_a_collision_told_sooner(rig: LockstepRig, library: str) -> None:
    with arm_in_lockstep(rig, library) as arm:
        typed: list[str] = []
        monitor = ValMonitor(Interpreter(arm, typed.append, lambda _: ""))
        assert monitor.obey("DO PAYLOAD 2, 0, , 50") == ""
        assert rig.mailbox.snapshot().payload_mass == 2.0
        for wrong, why in (
            ("PAYLOAD 5", HEAVY),
            ("PAYLOAD -1", "cannot carry that"),
            ("PAYLOAD", "PAYLOAD: expected 1 to 4 arguments, not 0"),
            ("PAYLOAD a", "a is not defined"),
            ("PARAMETER COLLISION = 0", "COLLISION is 1 to 100 per cent, not 0"),
            ("PARAMETER COLLISION = 101", "COLLISION is 1 to 100 per cent, not 101"),
            ("PARAMETER COLLIDE = 1", "there is no parameter COLLIDE; parameters are HAND.TIME, COLLISION"),
        ):
            assert why in monitor.obey(f"DO {wrong}")
        assert rig.mailbox.snapshot().payload_mass == 2.0
        monitor.obey("DO PAYLOAD 0")
        for line in ("PARAMETER COLLISION = 50", "PARAMETER COLLISION = 100", "ENABLE COMPLY"):
            assert monitor.obey(f"DO {line}") == ""
        pushed(rig, arm.sample)
        assert not arm.off_path, arm.kept
        assert monitor.obey("DO PARAMETER COLLISION = 50") == ""
        pushed(rig, arm.sample)
        assert "COLLISION" in arm.kept
        for _ in range(100):
            arm.sample()
        assert monitor.obey("PROCEED") == "the arm has gone back to its path"


VACUUM = EXAMPLES / "val/11_vacuum.toml"


def test_the_examples_carry_a_plate_by_the_vacuum_of_an_analogue_output(capsys: pytest.CaptureFixture[str]) -> None:
    ran = ["--lockstep", "--deployment", str(VACUUM)]
    for library in ("rccl", "arcl"):
        words = ["val", "run", *ran, "--library", library, "--speed", "100", str(VACUUM.with_suffix(".v2"))]
        assert run_app(make_app("val"), words) == 0, capsys.readouterr().err
        assert "the plate lies on the tray" in capsys.readouterr().out
    assert run_app(make_app("run"), ["run", *ran, str(EXAMPLES / "arcl/vacuum.py")]) == 0, capsys.readouterr().err
    assert "the plate lies on the tray" in capsys.readouterr().out


C_PROGRAM = """\
#include <arcl.h>
#include <stdio.h>
int main(int argc, char **argv)
{
    ROBOT *rp = arcl_open(ARCL_ARGCV, argc, argv, 0);
    double thresholds[6] = {20, 30, 20, 3, 3, 3}, inertia[6] = {.001, .001, .001};
    arcl_collision(rp, "comply", 6, thresholds);
    arcl_collision(rp, "stop", 0, NULL);
    arcl_setload(rp, 1.5, new_vector(0, 0, 40), inertia);
    printf("told\\n");
    fflush(stdout);
    arcl_setload(rp, 9., NULL, NULL);
    printf("never\\n");
    return 0;
}
"""


@needs_compiler
def test_a_program_in_c_tells_them_and_ends_at_what_is_refused(rig: LockstepRig, tmp_path: Path, capfd) -> None:
    (tmp_path / "load.c").write_text(C_PROGRAM)
    with rci.use(partial(link_factory, rig, 28_000)):
        assert run_c(compiled(tmp_path / "load.c", tmp_path), tmp_path, ami="bridge") == 1
    said = capfd.readouterr()
    assert said.out == "told\n", said.err
    assert HEAVY in said.err
    assert rig.mailbox.snapshot().payload_mass == 1.5


ANALOG_IN_C = """
main() {
    rccl_analog(1, 2.5);
    waitas(how.time > 300.)
    printf("it shows them\\n");
    fflush(stdout);
    rccl_analog(%s);
    printf("never\\n");
}
"""


@needs_compiler
@pytest.mark.usefixtures("own_cache")
@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ("1, 10.1", "is not within 0 to 10 V"),
        ("2, 1.", "there is no analogue output 2"),
        ("9, 1.", "are 1 to 8"),
    ],
)
def test_a_program_of_rccl_in_c_sets_an_analogue_output_and_ends_at_what_is_refused(
    wrong: str, why: str, tmp_path: Path, capfd
) -> None:
    rig = LockstepRig(ROBOT, servo_settings(choose_arm(str(VACUUM), None)))
    with rccl.use(partial(link_factory, rig, 28_000)):
        assert run_executable(compiled_text(ANALOG_IN_C % wrong, tmp_path)) == 1
    said = capfd.readouterr()
    assert said.out == "it shows them\n"
    assert why in said.err
    shown_v = (DAC_ZERO - rig.emulator.bundle.board.dac[6]) / DAC_COUNTS_PER_VOLT
    assert shown_v == pytest.approx(2.5, abs=0.003)  # the example holds it through a stop
