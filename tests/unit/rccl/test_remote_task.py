"""The task of a generator in another process has all that a program's hold asks of a task of its own."""

from __future__ import annotations

import ast
import inspect
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from qrobot.rccl import arm_session, channel, hand_and_outputs
from qrobot.rccl.process.remote_task import RemoteTask
from qrobot.rci import blackboard
from qrobot.rci.blackboard import Chg
from qrobot.wire import Command, State
from tests.support.packets import resting
from tests.support.puma import PERIOD_S, ROBOT


def asked_of_tasks(module: ModuleType) -> set[str]:
    """Names of attributes that a module takes of `self._task`."""
    nodes = (node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.Attribute))
    return {node.attr for node in nodes if isinstance(node.value, ast.Attribute) and node.value.attr == "_task"}


def test_a_channel_and_its_session_find_all_that_they_ask_of_a_task() -> None:
    process: Any = SimpleNamespace(ask=lambda *_: None)
    task = RemoteTask(ROBOT, PERIOD_S, process, "aux")
    asked = set().union(*map(asked_of_tasks, (channel, arm_session, hand_and_outputs)))
    assert len(asked) > 25
    needs_report = {name for name in asked if isinstance(inspect.getattr_static(RemoteTask, name, None), property)}
    assert {name for name in asked - needs_report if not hasattr(task, name)} == set()


def test_it_begins_to_stop_and_waits_for_no_answer_of_its_process() -> None:
    told: list[tuple[object, ...]] = []
    process: Any = SimpleNamespace(tell=lambda *order: told.append(order))
    RemoteTask(ROBOT, PERIOD_S, process, "aux").begin_stop()
    assert told == [("stop", 0.0)]


def test_what_a_program_changes_while_an_earlier_change_is_told_is_told_next() -> None:
    """The program's thread sets outputs and asks for a stop at any time, the thread of the reports tells."""
    told: list[dict[str, Any]] = []

    def tell(_order: str, changed: dict[str, Any]) -> None:
        told.append(changed)
        if len(told) == 1:
            task.chg.outputs, task.chg.stop = 0, True

    task = RemoteTask(ROBOT, PERIOD_S, SimpleNamespace(tell=tell), "aux")  # type: ignore[arg-type]
    task.chg.outputs = 4
    for _ in range(3):
        task.tell_changes()
    assert told == [{"outputs": 4}, {"outputs": 0, "stop": True}]


@pytest.mark.parametrize("name", ["stop", "clear_fault", "key_held"])
def test_what_a_program_raises_while_a_command_is_made_goes_out_with_the_next(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    chg = Chg(ROBOT.n)

    def make(*fields: Any) -> Command:
        command = Command(*fields)
        setattr(chg, name, not sent)
        return command

    monkeypatch.setattr(blackboard, "Command", make)
    sent, state = list[bool](), State(1, resting((0.0,) * ROBOT.n))
    for _ in range(3):
        sent.append(getattr(chg.command(state, 0), name))
    assert sent == [False, True, False]
