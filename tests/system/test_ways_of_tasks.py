"""Tasks of RCI, in Python and in C, in lock-step and live, name one of several arms: the same one hears of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TypeAlias

import pytest

from qrobot import rci
from qrobot.cli.arm_links import link_of, links_of
from qrobot.config.deployment import DeployedArm, load_deployment
from qrobot.errors import ConfigError
from qrobot.rccl.c.program import run_executable
from qrobot.rci import VirtualLink
from tests.support.c_programs import compiled, needs_compiler
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.puma import PARK

pytestmark = needs_compiler
REFUSED = 7
TASK = """
#include "rci.h"
static RCI_TASK *td;
static void rest(RCI_TASK *td) { (void) td; }
static int over(void) { return rci_runs(td) > 0; }
int main(int n, char **words)
{
    if (n != 3 || rci_robot(words[1], "puma560", words[2]))
        return 5;
    if ((td = rci_create(words[1], "")) == 0 || rci_control(td, rest, 0, 0))
        return 6;
    if (rci_start(td->bit))
        return 7;
    return rci_wait(over) || rci_close();
}
"""
ROWS = [  # name of the task, address of its bridge at two ports, and the arm of (left, right) that hears of it
    ("left", "", 0),
    ("right", "", 1),
    ("right", "127.0.0.1:{1}", 1),
    ("right", ":9", 1),  # the deployment file says where it is
    ("master", "127.0.0.1:{0}", 0),
    ("master", "127.0.0.1:{1}", 1),
    ("master", "localhost:{0}", 0),
    ("master", ":{1}", 1),
    ("right", "127.0.0.1:{0}", None),
    ("left", ":{1}", None),
    ("master", "", None),
    ("master", ":9", None),
    ("puma560", "", None),
]
Run: TypeAlias = Callable[[str, str], bool]
"""Runs a task of a name with its robot at an address, or at none; False when that is refused."""


def run_in_python(name: str, address: str) -> bool:
    rci.rci_robot(name, "puma560", address)
    td = rci.rci_create(name)
    rci.rci_control(td, lambda _: None)
    try:
        rci.rci_start(td.bit)
    except ConfigError:
        return False
    finally:
        rci.rci_close()
    return True


@pytest.fixture(scope="module", params=["Python", "C"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    if request.param == "Python":
        return run_in_python
    source = tmp_path_factory.mktemp("ways") / "task.c"
    source.write_text(TASK)
    return partial(run_in_c, compiled(source, source.parent))


def run_in_c(program: Path, name: str, address: str) -> bool:
    status = run_executable(program, [name, address])
    assert status in (0, REFUSED)
    return status == 0


def check(run: Run, arms: Callable[[], object]) -> None:
    for name, address, expected in ROWS:
        with arms() as (fakes, ports):
            done = run(name, address.format(*ports))
        heard = [number for number, fake in enumerate(fakes) if fake.commands]
        assert (done, heard) == (expected is not None, [] if expected is None else [expected]), (name, address)


def deployed(ports: list[int]) -> dict[str, DeployedArm]:
    arms = load_deployment("two_arms").arm
    return {
        arm.name: arm.model_copy(update={"bridge": arm.bridge.model_copy(update={"port": port})})
        for arm, port in zip(arms, ports, strict=True)
    }


@contextmanager
def emulated() -> Iterator[tuple[list[FakeRobot], list[int]]]:
    fakes, ports = {name: FakeRobot(tuple(PARK)) for name in ("left", "right")}, [5600, 5601]
    ways = links_of(list(deployed(ports).values()), lambda arm: partial(VirtualLink, transfer=fakes[arm.name].transfer))
    with rci.use(ways):
        yield list(fakes.values()), ports


@contextmanager
def running() -> Iterator[tuple[list[FakeRobot], list[int]]]:
    """Arms with bridges, and the ways to them that `qrobot run` gives."""
    fakes = [FakeRobot(tuple(PARK), patience=1 << 30) for _ in range(2)]
    with ExitStack() as served:
        ports = [served.enter_context(TcpRobot(fake, 0.005)).address[1] for fake in fakes]
        with rci.use(links_of(list(deployed(ports).values()), link_of), virtual_time=False):
            yield fakes, ports


def test_in_lockstep_the_arm_of_that_name_or_address_hears_of_a_task(run: Run) -> None:
    check(run, emulated)


@pytest.mark.realtime
def test_live_the_arm_of_that_name_or_address_hears_of_a_task(run: Run) -> None:
    check(run, running)
