"""No request to the servo is lost between two looks at its counter, and none is seen half."""

from __future__ import annotations

import ast
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import pytest

from qrobot.modecodes import Mode
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import jit_disabled, lean_kernel
from qrobot.servo import cycle
from qrobot.servo.memory import mailbox
from qrobot.servo.output_lines import OutputWire
from qrobot.servo.stages.mode_machine import handle_requests
from tests.support.bench_blocks import callable_block, in_python
from tests.support.servo_bench import ServoBench

POWERING: Final = int(Mode.POWERING)
STOPS: Final = 1_000 if jit_disabled() else 3_000_000
NOT_OF_THE_CYCLE: Final = {"names_told"}  # read by the thread that keeps the journal
LOOKS: Final = 10**12  # at most; the last stop is seen long before


@lean_kernel
def raise_stops(mail: Any, times: int) -> None:
    """Ask for so many stops, one after the other."""
    command = mail[0].command
    for k in range(times):
        store_release(command, "stops", k + 1)


@lean_kernel
def watch_stops(params: Any, state: Any, mail: Any, now_ns: int, last: int, looks: int) -> tuple[int, int]:
    """Look at requests until the last stop is seen: how often a stop was obeyed, and how often seen without that.

    An arm that waits for its power gives it up at a stop.
    """
    servo, obeyed, lost = state[0], 0, 0
    for _ in range(looks):
        seen = servo.stops_seen
        if seen == last:
            break
        servo.mode, servo.power_locked = POWERING, 0
        handle_requests(params[0], servo, mail[0], now_ns)
        if servo.power_locked != 0:
            obeyed += 1
        elif servo.stops_seen != seen:
            lost += 1
    return obeyed, lost


def test_every_stop_that_is_seen_is_obeyed_beside_a_thread_that_asks_for_them() -> None:
    bench = ServoBench().wait_for_power()
    assert bench.mode is Mode.POWERING
    mail = callable_block(bench.mail)
    watched = callable_block(in_python(bench.params)), callable_block(bench.state), mail, bench.now_ns
    raise_stops(mail, 0)
    watch_stops(*watched, 0, 1)  # both compiled now
    thread = threading.Thread(target=raise_stops, args=(mail, STOPS))
    thread.start()
    obeyed, lost = watch_stops(*watched, STOPS, LOOKS)
    thread.join()
    assert lost == 0
    assert 0 < obeyed <= STOPS


# ------------------------------------------------------------------------------------------------------ by the source


def raised_counters() -> set[str]:
    """The fields of the block of commands that its mailbox raises."""
    calls = (node for node in ast.walk(ast.parse(Path(mailbox.__file__).read_text())) if isinstance(node, ast.Call))
    raised = (call.args[0] for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "_raise")
    return {str(name.value) for name in raised if isinstance(name, ast.Constant)}


def is_command(node: ast.AST) -> bool:
    """`mail.command`, or the same by its short name."""
    named = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
    return named == "command"


def reads_of(tree: ast.AST) -> tuple[list[str], list[str]]:
    """Names of fields of the block of commands that are loaded with acquire, and of all that are named in any way."""
    named = [node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute) and is_command(node.value)]
    loads = [
        node.args
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == load_acquire.__name__
    ]
    words = [key.value for place, key in loads if is_command(place) and isinstance(key, ast.Constant)]
    elements = [place.attr for place, _ in loads if isinstance(place, ast.Attribute) and is_command(place.value)]
    return [str(word) for word in words] + elements, named + [str(word) for word in words]


def test_every_counter_of_a_request_is_loaded_once_in_a_cycle() -> None:
    servo = Path(cycle.__file__).parent
    parts = (servo.glob(f"{part}/*.py") for part in (".", "calibration", "checks", "kernels", "laws", "stages"))
    reads = [reads_of(ast.parse(path.read_text())) for part in parts for path in part]
    loaded = [name for words, _ in reads for name in words]
    named = [name for _, names in reads for name in names]
    counters = raised_counters() - NOT_OF_THE_CYCLE
    assert {"stops", "power_offs", "power_ons", "clears", "outputs_let_go", "analog_told"} < counters
    assert {name: (loaded.count(name), named.count(name)) for name in counters} == dict.fromkeys(counters, (1, 1))


# ------------------------------------------------------------------------------------- with a cycle between two words


class Interrupted:
    """The block of commands, with a cycle of the servo before every word that is touched and every one that is set."""

    def __init__(self, bench: ServoBench) -> None:
        vars(self).update(command=bench.mail.command, bench=bench)

    def __getattr__(self, name: str) -> Any:
        self.bench.tick()
        return getattr(self.command, name)

    def __setattr__(self, name: str, value: object) -> None:
        self.bench.tick()
        setattr(self.command, name, value)


def interrupt(bench: ServoBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let cycles come between the words of every request from now on."""
    monkeypatch.setattr(bench.mailbox, "memory", SimpleNamespace(command=Interrupted(bench)))


def test_a_line_that_was_locked_is_not_on_while_its_program_lets_go_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = ServoBench(outputs=(OutputWire(1, "glue", holds=False, bit=3),)).tick(3)
    bench.mailbox.request_outputs(1, bench.now_ns)
    bench.tick()
    assert bench.snapshot.outputs == 1
    bench.mailbox.request_stop()
    bench.tick(2)
    assert bench.snapshot.outputs == 0
    shown: list[int] = []
    bench.before.append(lambda _: shown.append(bench.snapshot.outputs))
    interrupt(bench, monkeypatch)
    bench.mailbox.request_outputs(0, bench.now_ns)
    bench.tick(2)
    assert len(shown) > 3
    assert not any(shown)
    bench.mailbox.request_outputs(1, bench.now_ns)
    assert bench.tick(2).snapshot.outputs == 1


def test_thresholds_of_a_collision_change_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = ServoBench()
    asked: list[float] = []
    bench.mailbox.request_collision([10.0, 20.0], 0)
    bench.tick()
    bench.before.append(lambda _: asked.append(float(bench.state.watch.asked[1])))
    interrupt(bench, monkeypatch)
    bench.mailbox.request_collision([30.0, 40.0, 50.0], 1)
    bench.tick(2)
    assert set(asked) == {20.0, 40.0}
    assert bench.state.watch.asked.tolist() == [30.0, 40.0, 50.0, 0.0, 0.0, 0.0]
