"""Surroundings of a program that uses RCI: the way to its robots, and whether its time is real."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial
from typing import Final, TypeAlias

from qrobot.errors import ConfigError
from qrobot.rci.link import Link, LinkFactory, hello_for
from qrobot.rci.robot_data import KnownRobot, RobotData
from qrobot.rci.tcp import TcpLink, bridge_address
from qrobot.wire import Hello

OpenLink: TypeAlias = Callable[[int], Link]
"""The way to the robot of a task, greeted with a sample period in us, 0 for the bridge's."""

RobotLinks: TypeAlias = Callable[[KnownRobot, Hello], Link]


def tcp_links(robot: KnownRobot, hello: Hello) -> Link:
    """The way over TCP to the robot's own bridge, or else to the one that QROBOT_BRIDGE names."""
    return TcpLink(hello, bridge_address(robot.bridge or None))


@dataclass(frozen=True)
class Environment:
    """Surroundings of a program.

    Attributes:
        links: makes the way to a robot.
        virtual_time: time passes only while the program waits, and everything happens in its own thread.
        bridges: where the arms are that `links` knows by name, "host:port"; none where it knows no names.
    """

    links: RobotLinks = tcp_links
    virtual_time: bool = False
    bridges: Mapping[str, str] = field(default_factory=dict)


_REAL_TIME: Final = Environment()
_environment: ContextVar[Environment] = ContextVar("environment", default=_REAL_TIME)


def environment() -> Environment:
    """Surroundings of the program that calls."""
    return _environment.get()


def link_maker(environment: Environment, known: KnownRobot | None, data: RobotData | None) -> OpenLink | None:
    """Opener of the way to a robot of the data base; None without one."""
    return None if known is None or data is None else partial(_greet, environment, known, data.robot.name)


def _greet(environment: Environment, known: KnownRobot, robot: str, period_us: int) -> Link:
    return environment.links(known, hello_for(robot, period_us))


@contextmanager
def use(factory: LinkFactory | dict[str, LinkFactory], virtual_time: bool = True) -> Iterator[None]:
    """Programs run in this context reach their robots by the links of `factory`.

    When there are several each has the name of its robot, and may have "host:port" of a bridge, by which a program may
    name it instead.
    """

    def links(robot: KnownRobot, hello: Hello) -> Link:
        chosen = _way(factory, robot) if isinstance(factory, dict) else factory
        return chosen(hello)

    bridges = _bridges(factory) if isinstance(factory, dict) else {}
    token = _environment.set(Environment(links, virtual_time, bridges))
    try:
        yield
    finally:
        _environment.reset(token)


def _bridges(ways: dict[str, LinkFactory]) -> dict[str, str]:
    """The addresses of the arms that have names: of two keys of one way."""
    places = {place: way for place, way in ways.items() if ":" in place}
    return {name: place for name in ways.keys() - places.keys() for place, way in places.items() if way is ways[name]}


def _way(ways: dict[str, LinkFactory], robot: KnownRobot) -> LinkFactory:
    """The way to a robot. Raises ConfigError: there is none, or another arm has its name than is at its address."""
    place = robot.place
    named, placed = ways.get(robot.name), ways.get(place)
    if named is not None and placed is not None and named is not placed:
        raise ConfigError(
            f"robot {robot.name!r} at {place}: another arm has that name here; leave out the address, or name the "
            "robot as that arm, or as none is named"
        )
    if (chosen := named or placed) is None:
        name, there = repr(robot.name or robot.file), ", ".join(ways)
        wanted = f"{name} at {place}" if place else name
        raise ConfigError(f"no way to robot {wanted} is given here; there is one to {there}; --arm chooses one")
    return chosen
