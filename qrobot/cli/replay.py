"""`qrobot replay`: a setpoint file on an arm that runs, or in lock-step without one."""

from __future__ import annotations

from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, controlled_robot, fences_of_arm, inside_fences, robot_of_arm
from qrobot.cli.console import note, out, write_json
from qrobot.cli.option_types import OutputTable, SmoothOption
from qrobot.realtime.signals import ends_as_ctrl_c
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, NS_PER_S, S_PER_MS, US_PER_MS

if TYPE_CHECKING:
    from qrobot.arrays import Floats
    from qrobot.config import Robot
    from qrobot.config.deployment import DeployedArm
    from qrobot.rccl.channel import Channel
    from qrobot.rccl.setpoints import Setpoints
    from qrobot.rci import LinkFactory


SLOWED_S: Final = 0.5  # by which a replay takes longer that was slowed down or paused


@ends_as_ctrl_c()
def replay(
    file: Path,
    *,
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
    lockstep: bool = False,
    approach: bool = False,
    then: list[Path] | None = None,
    smooth: SmoothOption | None = None,
    save_as: OutputTable | None = None,
    json: bool = False,
) -> None:
    """Send the setpoints of a file to an arm, one each sample period.

    Such files are written by `qrobot run --offline`. Tables of other programs pass as well, CSV or Parquet: a column
    `t_s` of seconds at even steps, and `q1`, `q2` and so on, or the names of the joints, in rad (m). Before anything
    moves the whole file is judged: it has to be for this arm, keep the joints' ranges, speeds and accelerations, begin
    and end at rest, and begin where the arm stands.

      qrobot run --offline examples/02_four_corners.py
      qrobot replay out/offline/02_four_corners/setpoints.csv

    Parameters
    ----------
    file
        The setpoint file.
    deployment
        Deployment file, or the name of a packaged one: tells where the bridge is.
    arm
        Which arm of the file; may be left out when there is only one.
    lockstep
        On an emulated arm inside this process, on virtual time.
    approach
        Move to the first setpoint before, if the arm stands elsewhere.
    then
        Another file of the same sample period, to be played after it, may be given several times; the arm goes slowly
        from the end of one to the beginning of the next.
    smooth
        Smooth the motion, by at most so many mm at the flange and 100 mm beside it, and slow it down where it is too
        fast: for what a hand has led (`qrobot guide`).
    save_as
        Write the setpoints to this file instead, `.csv` or `.parquet`, and move nothing.
    json
        Print JSON: of each joint the largest error, rad (m).
    """
    from qrobot.cli.arm_links import link_of
    from qrobot.motion import motion_limits
    from qrobot.rccl.connect import open_channel
    from qrobot.rccl.position import Position
    from qrobot.rccl.setpoint_tables import write_setpoint_table
    from qrobot.rccl.setpoints import judge
    from qrobot.realtime.interrupt import heed_interrupts

    chosen = choose_arm(deployment, arm)
    robot = robot_of_arm(chosen)
    setpoints = _made_up([file, *(then or ())], smooth, robot)
    if save_as is not None:
        save_as.parent.mkdir(parents=True, exist_ok=True)
        write_setpoint_table(save_as, setpoints)
        note(f"wrote {save_as}")
        return
    period_ms = setpoints.period_us / US_PER_MS
    # `play` does so too, but behind the way to the first setpoint
    judge(setpoints, robot.name, period_ms * S_PER_MS, motion_limits(robot), fences_of_arm(chosen), str(file))
    factory = _lockstep_links(chosen, setpoints.period_us) if lockstep else link_of(chosen)
    heeding = heed_interrupts() if lockstep else nullcontext()
    with heeding, inside_fences(chosen), open_channel(factory, chosen.robot, period_ms) as channel:
        if approach:
            channel.move(Position("first setpoint", setpoints.q[0]))
            channel.waitfor(channel.completed)
        channel.play(setpoints, str(file))
        begin_ns = channel.how.t_ns
        worst = _worst_errors(channel)
        took_s = (channel.how.t_ns - begin_ns) / NS_PER_S
    if json:
        errors = dict(zip(robot.joint_names, worst.tolist(), strict=True))
        seconds = {"seconds": float(setpoints.t[-1]), "seconds_taken": took_s}
        write_json({"setpoints": len(setpoints.q), **seconds, "largest_error": errors})
        return
    slower = f", slowed to {took_s:.2f} s" if took_s > setpoints.t[-1] + SLOWED_S else ""
    told = f"{len(setpoints.q)} setpoints in {setpoints.t[-1]:.2f} s{slower}"
    out.print(f"{told}; farthest from them: {_in_words(worst, robot)}")


def _made_up(files: list[Path], smooth_mm: float | None, robot: Robot) -> Setpoints:
    """The setpoints of the files, joined and smoothed. Raises ConfigError or MotionError when they cannot be."""
    from qrobot.rccl.recordings import joined, smoothed
    from qrobot.rccl.setpoint_tables import read_setpoint_table

    parts = [read_setpoint_table(file, robot) for file in files]
    if smooth_mm is not None:
        parts = [smoothed(part, robot, smooth_mm * M_PER_MM) for part in parts]
    return joined(parts, robot) if len(parts) > 1 else parts[0]


def _lockstep_links(arm: DeployedArm, period_us: int) -> LinkFactory:
    from qrobot.cli.servo_settings import servo_settings  # kernels
    from qrobot.rig.lockstep import LockstepRig, link_factory
    from qrobot.sim_board.deployed import emulator_of_arm

    emulator = emulator_of_arm(arm, robot_of_arm(arm))
    rig = LockstepRig(controlled_robot(arm, emulated=True)[0], servo_settings(arm), emulator, keep_telemetry=False)
    return partial(link_factory, rig, period_us)


def _worst_errors(channel: Channel) -> Floats:
    """Wait until the motion is completed; the largest errors seen at its samples, rad or m. Shape (n,)."""
    import numpy as np

    worst = np.zeros(channel.robot.n)

    def completed() -> bool:
        how = channel.how
        np.maximum(worst, np.abs(np.subtract(how.q, how.q_setpoint)), out=worst)
        return channel.completed.count > 0

    channel.waitas(completed)
    return worst


def _in_words(worst: Floats, robot: Robot) -> str:
    """The largest error of turning joints, and that of sliding ones where there are some."""
    sliding = robot.prismatic
    parts = (worst[~sliding] * DEG_PER_RAD, "deg"), (worst[sliding] * MM_PER_M, "mm")
    return ", ".join(f"{values.max():.3f} {unit}" for values, unit in parts if values.size)
