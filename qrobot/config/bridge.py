"""Addresses at which programs reach an arm: on the loopback interface, and on an isolated link where there is one."""

from __future__ import annotations

from ipaddress import ip_address

from pydantic import Field, field_validator

from qrobot.config.document import Table

FIRST_PORT = 1024


class LinkChoice(Table):
    """An isolated network link: a cable to another host, whose programs command the arm over it without a tunnel.

    `interface` and `address` are this machine's end of it, `peers` the addresses of the other hosts. `token_file` holds
    the secret that programs there have to show; a relative path starts at this file. Nothing is encrypted: whoever
    reaches the cable can listen in. Everywhere else, use a tunnel.
    """

    interface: str = Field(pattern=r"^[^/\s]{1,15}$")
    address: str
    peers: tuple[str, ...] = Field(min_length=1, max_length=16, strict=False)
    token_file: str

    @field_validator("address", "peers")
    @classmethod
    def _are_addresses(cls, found: str | tuple[str, ...]) -> str | tuple[str, ...]:
        for text in (found,) if isinstance(found, str) else found:
            address = ip_address(text)  # ValueError names what it is not
            if address.is_unspecified or address.is_loopback or address.is_multicast:
                raise ValueError(f"{text} is no address of one machine on a cable")
        return found


class BridgeChoice(Table):
    """Address at which programs connect, on the loopback interface, and the default sample period."""

    host: str = "127.0.0.1"
    port: int = Field(ge=FIRST_PORT, le=65535)
    period_ms: float = Field(default=28.0, ge=1, le=100, allow_inf_nan=False)
    link: LinkChoice | None = None

    @field_validator("host")
    @classmethod
    def _is_on_the_loopback_interface(cls, host: str) -> str:
        if host != "localhost" and not ip_address(host).is_loopback:
            raise ValueError(
                f"{host!r} is beyond the loopback interface; programs of other hosts come by a tunnel or a link"
            )
        return host
