"""The task of a generator in another process has all that a program's hold asks of a task of its own."""

from __future__ import annotations

import ast
import inspect
from types import ModuleType, SimpleNamespace
from typing import Any

from qrobot.rccl import arm_session, channel, hand_and_outputs
from qrobot.rccl.process.remote_task import RemoteTask
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
