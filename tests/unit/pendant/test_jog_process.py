"""The process that moves an arm for the pendant: when it takes the arm, and when it does not."""

from __future__ import annotations

import io
import json
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot.config import load_deployment
from qrobot.config.deployment import DeployedArm
from qrobot.errors import LinkLost
from qrobot.pendant import jog_session
from qrobot.pendant.jog_process import LATE_S, JogProcess, fences_of_told
from qrobot.pendant.jog_worker import told_arm
from tests.support.patience import PATIENCE_S, give_time, wait_until

ON = '{"do": "on"}'


def sessions(answers: io.StringIO) -> list[str]:
    """What became of the session, one after the other."""
    return [json.loads(line)["session"] for line in answers.getvalue().splitlines()]


def serve(lines: Iterator[str], answers: io.StringIO) -> None:
    """Let a process that jogs the arm obey lines to their end."""
    process = JogProcess("puma560", pytest.fail, Path("unused"), answers)
    reader = threading.Thread(target=process.read, args=(lines,))
    reader.start()
    process.run()
    reader.join()


@pytest.mark.realtime
def test_a_second_on_does_not_take_the_arm_again_after_its_session_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    began, told_twice, answers = threading.Event(), threading.Event(), io.StringIO()
    taken: list[str] = []

    def take(_link: object, robot: str, _period_ms: float) -> None:
        taken.append(robot)
        began.set()
        assert told_twice.wait(PATIENCE_S)
        raise LinkLost("power was taken away")

    def lines() -> Iterator[str]:
        yield ON
        assert began.wait(PATIENCE_S)
        yield ON  # a double click
        told_twice.set()
        give_time()
        yield '{"do": "release"}'

    monkeypatch.setattr(jog_session, "open_channel", take)
    serve(lines(), answers)
    assert "power was taken away" in answers.getvalue()
    assert taken == ["puma560"]


@pytest.mark.realtime
@pytest.mark.parametrize(("line", "told"), [("stop", "STOP was pressed"), ("off", "")])
def test_an_arm_that_is_asked_for_while_the_process_still_compiles_is_not_taken_after_a_stop(
    line: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers, asked = io.StringIO(), threading.Event()

    def lines() -> Iterator[str]:
        yield ON
        yield f'{{"do": "{line}"}}'
        asked.set()
        give_time()

    monkeypatch.setattr(jog_session, "open_channel", lambda *_args: pytest.fail("the arm is taken"))
    process = JogProcess("puma560", pytest.fail, Path("unused"), answers)
    reader = threading.Thread(target=process.read, args=(lines(),))
    reader.start()
    assert asked.wait(PATIENCE_S)
    process.run()  # as after `compile_motion`
    reader.join()
    first, *others = sessions(answers)
    assert (first, set(others)) == ("opening", {"no"})
    assert told in answers.getvalue()


@pytest.mark.realtime
@pytest.mark.parametrize("waited_s", [LATE_S - 0.1, LATE_S + 0.1])
def test_an_arm_that_was_asked_for_long_before_the_process_is_ready_is_not_taken(
    waited_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers, taken, now = io.StringIO(), list[str](), [100.0]

    def take(_link: object, robot: str, _period_ms: float) -> None:
        taken.append(robot)
        raise LinkLost("power was taken away")

    def lines() -> Iterator[str]:
        yield ON
        now[0] += waited_s
        asked.set()
        wait_until(lambda: sessions(answers)[-1] == "no")

    asked = threading.Event()
    monkeypatch.setattr(jog_session, "open_channel", take)
    process = JogProcess("puma560", pytest.fail, Path("unused"), answers, lambda: now[0])
    reader = threading.Thread(target=process.read, args=(lines(),))
    reader.start()
    assert asked.wait(PATIENCE_S)
    process.run()  # as after `compile_motion`
    reader.join()
    assert taken == (["puma560"] if waited_s < LATE_S else [])
    assert sessions(answers)[0] == "opening"  # the page shows that it is under way
    assert ("take it now" in answers.getvalue()) == (waited_s > LATE_S)


@pytest.mark.realtime
@pytest.mark.parametrize("off", ["", ', "power_off": true'])
def test_people_are_told_why_the_pendant_no_longer_commands_the_arm(off: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop that ends a session says so, and says nothing of what ends the next one."""
    began, stopped, answers = threading.Event(), threading.Event(), io.StringIO()

    def take(*_args: object) -> None:
        began.set()
        assert stopped.wait(PATIENCE_S)
        raise LinkLost("power was taken away")

    def lines() -> Iterator[str]:
        yield ON
        assert began.wait(PATIENCE_S)
        yield f'{{"do": "stop"{off}}}'
        began.clear()
        stopped.set()
        wait_until(lambda: "was pressed" in answers.getvalue())
        yield ON
        assert began.wait(PATIENCE_S)
        wait_until(lambda: "power was taken away" in answers.getvalue())

    monkeypatch.setattr(jog_session, "open_channel", take)
    serve(lines(), answers)
    first, second = [line for line in answers.getvalue().splitlines() if json.loads(line)["text"]]
    assert ("Power off was pressed" if off else "STOP was pressed") in first
    assert "pressed" not in second
    assert "power was taken away" in second


@pytest.mark.realtime
def test_a_line_that_cannot_be_obeyed_is_the_end_of_the_process() -> None:
    answers = io.StringIO()
    process = JogProcess("puma560", pytest.fail, Path("unused"), answers)
    with pytest.raises(ValueError, match="Expecting value"):
        process.read([ON, "no JSON"])
    process.run()  # does not take the arm, and ends
    assert sessions(answers)[:2] == ["opening", "no"]
    assert sessions(answers).count("opening") == 1


DRIVES = """
board = { kind = 'drives', drives = { mode = 'position', absolute = true, nodes = [1, 2, 3, 4, 5, 6],
  increments_per_count = [1, 1, 1, 1, 1, 1], counts_at_zero = [0, 0, 0, 0, 0, 0] } }
servo = { board_timeout_ms = 20 }
""".replace("\n ", "").strip()


@pytest.mark.parametrize("more", ["", "servo = { law = 'pd' }", DRIVES])
def test_the_process_is_told_robot_bridge_and_fences_of_its_arm(more: str, tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    fences = "[arm.fences]\nself_collision = true\nshape = [{ name = 'floor1', shape = 'plane' }]\n"
    file.write_text(f'[[arm]]\nname = "one"\nrobot = "puma560"\nbridge = {{ port = 5600 }}\n{more}\n{fences}')
    arm = load_deployment(file).arm[0]
    told = DeployedArm.model_validate_json(told_arm(arm))
    assert (told.robot, told.bridge, told.fences) == (arm.robot, arm.bridge, arm.fences)
    assert (told.board.scene, told.servo.tool_mm) == (arm.board.scene, arm.servo.tool_mm)
    found = fences_of_told(told)
    assert found is not None
    assert found.names == ("floor1", "itself")
