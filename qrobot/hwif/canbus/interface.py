"""Any interface of python-can by name, and one that keeps CAN over UDP multicast on this machine."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

from qrobot.config.can import MULTICAST
from qrobot.errors import ConfigError, LinkError
from qrobot.extras import missing_library

if TYPE_CHECKING:
    import can


def load_can() -> ModuleType:
    """The package python-can. Raises ConfigError when it is not installed."""
    try:
        import can
    except ImportError:
        raise ConfigError(missing_library("can")) from None
    return can


def open_interface(interface: str, channel: str, bitrate: int = 1_000_000) -> can.BusABC:
    """A CAN interface, as python-can names it; `udp_multicast` never leaves this machine.

    Raises:
        ConfigError: python-can is not installed.
        LinkError: there is no such interface or channel, or it does not open.
    """
    library = load_can()
    try:
        if interface == MULTICAST:
            from qrobot.hwif.canbus.multicast import LocalMulticast

            return LocalMulticast(channel)
        opened: can.BusABC = library.Bus(interface=interface, channel=channel, bitrate=bitrate)
    except (library.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
        raise LinkError(f"CAN interface {interface}:{channel} does not open: {error}") from error
    return opened
