"""`qrobot modbus`: show a running robot to Modbus clients."""

from __future__ import annotations

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm
from qrobot.cli.console import note

ADDRESS = "127.0.0.1:1502"


def modbus(deployment: str = DEFAULT_DEPLOYMENT, *, arm: str | None = None, listen: str = ADDRESS) -> None:
    """Show a running robot to Modbus TCP clients, until Ctrl-C: its board, joints, torques, mode and fault.

    For reading only: the servo has the board, and writes are refused with exception 6. It may be started before the
    servo and outlives it; meanwhile clients get exception 4. The map is a page of the documentation. To let a Modbus
    client command an emulated board instead, see `qrobot board --serve`.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    listen
        HOST:PORT, or HOST:PORT+CLIENT,... with addresses or networks of other machines that may connect. On this
        machine it is this account and root.
    """
    from qrobot.hwif.modbus.library import require_pymodbus

    require_pymodbus()
    from qrobot.hwif.modbus.device import ModbusDevice
    from qrobot.hwif.modbus.server import ModbusServer, split_address
    from qrobot.realtime.signals import set_on_signals
    from qrobot.rig.modbus_robot import RunningRobot

    chosen = choose_arm(deployment, arm)
    host, port, _, allowed = split_address(listen)
    robot = RunningRobot(chosen.name)
    device = ModbusDevice(robot, robot=robot.registers, holder=robot)
    with set_on_signals() as done, ModbusServer(device, host, port, allowed) as server:
        note(f"{chosen.name} is shown at {server.address[0]}:{server.address[1]}")
        done.wait()
    robot.close()
