"""Files that say where processors on other hosts are, and what may be done there."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field, model_validator

from qrobot.config.document import Table, check_document, read_document
from qrobot.errors import ConfigError
from qrobot.realtime.loopback import is_loopback

HOSTS_VARIABLE: Final = "QROBOT_HOSTS"
_ENDPOINT: Final = re.compile(r"(tcp|tls)/(\[[0-9a-fA-F:]+\]|[\w.-]+):([0-9]{1,5})")
HostName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
ModuleName = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*$")]
CommonName = Annotated[str, Field(min_length=1, max_length=64)]


class TlsFiles(Table):
    """PEM files of one end: the authority that signed both, its own certificate and its private key."""

    authority: str
    certificate: str
    key: str


class KnownHost(Table):
    """Place of a host. Beyond the loopback interface the endpoint begins with `tls/`, and `tls` names the files."""

    name: HostName
    endpoint: str
    tls: TlsFiles | None = None

    @model_validator(mode="after")
    def _check_endpoint(self) -> KnownHost:
        found = _ENDPOINT.fullmatch(self.endpoint)
        if found is None or not 0 < int(found[3]) < 1 << 16:
            raise ValueError(f"endpoint {self.endpoint!r}: tcp/ADDRESS:PORT or tls/ADDRESS:PORT is needed")
        if found[1] == "tcp" and not self.on_loopback:
            raise ValueError(
                f"endpoint {self.endpoint!r} is beyond the loopback interface, where certificates of both ends are "
                "required: tls/ADDRESS:PORT and a table tls with authority, certificate and key"
            )
        if (found[1] == "tls") != (self.tls is not None):
            raise ValueError("an endpoint tls/ and the table tls go together: authority, certificate and key")
        return self

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the endpoint."""
        host, _, port = self.endpoint.partition("/")[2].rpartition(":")
        return host.strip("[]"), int(port)

    @property
    def on_loopback(self) -> bool:
        """The endpoint is on the loopback interface."""
        host = self.address[0]
        return host == "localhost" or is_loopback(host)


class HostSettings(KnownHost):
    """Offer of a host: functions of `modules`, to programs whose certificates have a common name of `allow`."""

    modules: Annotated[tuple[ModuleName, ...], Field(strict=False, min_length=1)]
    allow: Annotated[tuple[CommonName, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _check_access(self) -> HostSettings:
        if self.tls is not None and not self.allow:
            raise ValueError(
                "allow: name the programs that may use this host, by the common names of their certificates"
            )
        if self.tls is None and self.allow:
            raise ValueError("allow: programs are known by their certificates, which only an endpoint tls/ asks for")
        return self


class HostList(Table):
    """The hosts that a program knows."""

    host: Annotated[tuple[KnownHost, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _check_names(self) -> HostList:
        names = [host.name for host in self.host]
        if len(set(names)) < len(names):
            raise ValueError(f"two hosts of one name: {', '.join(names)}")
        return self


def load_host_settings(path: Path) -> HostSettings:
    """Settings of the host that runs here; files are found from the folder of `path`. Raises ConfigError."""
    document = read_document(path)
    settings = check_document(HostSettings, _with_paths(document, path.parent), str(path))
    _check_files(settings, path)
    return settings


def known_hosts() -> dict[str, KnownHost]:
    """The hosts of the file that QROBOT_HOSTS names, by their names; none without it. Raises ConfigError."""
    named = os.environ.get(HOSTS_VARIABLE, "")
    if not named:
        return {}
    path = Path(named)
    document = read_document(path)
    if isinstance(document.get("host"), list):
        document["host"] = [_with_paths(entry, path.parent) for entry in document["host"]]
    hosts = check_document(HostList, document, str(path)).host
    for host in hosts:
        _check_files(host, path)
    return {host.name: host for host in hosts}


def find_host(name: str) -> KnownHost:
    """A host by its name. Raises ConfigError, with those that are known."""
    hosts = known_hosts()
    if name not in hosts:
        where = f"{HOSTS_VARIABLE} names {', '.join(hosts)}" if hosts else f"{HOSTS_VARIABLE} names no file of hosts"
        raise ConfigError(f"no host {name!r}: {where}")
    return hosts[name]


def _with_paths(document: Any, folder: Path) -> Any:
    """Files of the table tls, from the folder of the file that names them."""
    tls = document.get("tls") if isinstance(document, dict) else None
    if not isinstance(tls, dict):
        return document
    found = {key: str(folder / value) if isinstance(value, str) else value for key, value in tls.items()}
    return {**document, "tls": found}


def _check_files(host: KnownHost, path: Path) -> None:
    if host.tls is not None:
        for key, file in host.tls.model_dump().items():
            if not Path(file).is_file():
                raise ConfigError(f"{path}: host {host.name}: tls.{key}: no file {file}")
