"""Programs of every library name one of several arms, by names and addresses: that one hears of them, or none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import pytest

from qrobot import rci
from qrobot.arcl import ARCL_BRIDGE, arcl_close, arcl_open
from qrobot.cli.arm_links import links_of
from qrobot.config.deployment import DeployedArm, load_deployment
from qrobot.errors import ConfigError
from qrobot.multi_rccl import rccl_control, rccl_open, rccl_release
from qrobot.multi_rccl.program import _program
from qrobot.rccl.program import ending
from qrobot.rci import VirtualLink
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK

pytestmark = pytest.mark.usefixtures("arcl_alone")

KIND = "puma560"  # of both arms: their robot file, and perhaps the name of one
NAMES = [("left", "right"), (KIND, "second"), ("first", KIND)]
PLACES = ("127.0.0.1:5600", "127.0.0.1:5601")


def deployed(names: tuple[str, str]) -> list[DeployedArm]:
    arms = load_deployment("two_arms").arm
    return [arm.model_copy(update={"name": name}) for arm, name in zip(arms, names, strict=True)]


@contextmanager
def arms(names: tuple[str, str]) -> Iterator[Callable[[], list[int]]]:
    """The ways that `qrobot run` gives to two arms of a deployment file; tells which of them were commanded."""
    fakes = {name: FakeRobot(tuple(PARK)) for name in names}
    token = _program.set(None)
    ways = links_of(deployed(names), lambda arm: partial(VirtualLink, transfer=fakes[arm.name].transfer))
    with rci.use(ways), ending():
        yield lambda: [number for number, fake in enumerate(fakes.values()) if fake.commands]
        rci.rci_close()
    _program.reset(token)


def program_of_arcl(_: str, address: str) -> None:
    arcl_close(arcl_open(ARCL_BRIDGE, address, 0))


def program_of_multi_rccl(name: str, address: str) -> None:
    arm = rccl_open(name, KIND, address)
    rccl_control(arm)
    rccl_release(arm)


def program_of_rci(name: str, address: str) -> None:
    rci.rci_robot(name, KIND, address)
    td = rci.rci_create(name)
    rci.rci_control(td, lambda _: None)
    rci.rci_start(td.bit)
    rci.rci_release(td.bit)


LIBRARIES = [program_of_arcl, program_of_multi_rccl, program_of_rci]
NAMING = [program_of_multi_rccl, program_of_rci]  # arms have names there


@pytest.mark.parametrize("program", LIBRARIES)
@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("number", [0, 1])
def test_an_address_leads_to_the_arm_whose_bridge_is_there(program, names, number: int) -> None:
    for name, address in [
        ("mine", PLACES[number]), (names[number], PLACES[number]), ("mine", f"localhost:560{number}"),
    ]:  # fmt: skip
        with arms(names) as commanded:
            program(name, address)
            assert commanded() == [number]


@pytest.mark.parametrize("names", NAMES)
def test_an_address_of_nobodys_bridge_in_arcl_leads_to_no_arm_that_is_called_as_the_robot_is(names) -> None:
    with arms(names) as commanded:
        with pytest.raises(ConfigError, match=r"no way to robot 'puma560' at 127\.0\.0\.1:5609"):
            program_of_arcl("", ":5609")
        assert commanded() == []


@pytest.mark.parametrize("program", NAMING)
@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("address", ["", ":5609"])
def test_a_name_leads_to_the_arm_that_the_file_calls_so_wherever_it_is(program, names, number, address) -> None:
    with arms(names) as commanded:
        program(names[number], address)
        assert commanded() == [number]


@pytest.mark.parametrize("program", NAMING)
@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("number", [0, 1])
def test_the_name_of_one_arm_with_the_address_of_another_moves_neither(program, names, number: int) -> None:
    with arms(names) as commanded:
        with pytest.raises(ConfigError, match=f"'{names[number]}' at .*: another arm has that name here"):
            program(names[number], PLACES[1 - number])
        assert commanded() == []
