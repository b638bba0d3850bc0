"""The bridge: user programs on one side over TCP, the servo on the other behind a small port.

It plays the part of the QRobot paper's "RCCL interface" (section 6): packets flow both ways at the sample period,
setpoints in, the robot's state out. `session` decides without I/O, `server` moves bytes, `servo_interface` is all it
knows of the servo.
"""

from qrobot.rccl_bridge.actions import Action, Close, Forward, SendBytes, SessionOutcome, StopArm, carry_out
from qrobot.rccl_bridge.lease import Lease
from qrobot.rccl_bridge.server import BridgeServer, run_bridge
from qrobot.rccl_bridge.servo_interface import RobotPort, RobotState, SetpointFrame
from qrobot.rccl_bridge.session import Session
from qrobot.rccl_bridge.settings import BridgeSettings

__all__ = [
    "Action",
    "BridgeServer",
    "BridgeSettings",
    "Close",
    "Forward",
    "Lease",
    "RobotPort",
    "RobotState",
    "SendBytes",
    "Session",
    "SessionOutcome",
    "SetpointFrame",
    "StopArm",
    "carry_out",
    "run_bridge",
]
