"""The page on control laws: its laws run as they stand there."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.config.deployment import ServoChoice
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.laws.trial import prove
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.unit.servo.test_law import call

PAGE = (Path(__file__).parents[3] / "docs/how-to/write-a-control-law.md").read_text()
FILES = dict(re.findall(r"<!-- file: (\S+) -->\n```python\n(.*?)```", PAGE, re.DOTALL))
ROBOT = load_robot("puma560")
LAWS = ["my_laws.py:guided", "my_expressions.py:light_hand", "my_signals.py:metered"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", LAWS)
def test_the_laws_of_the_page_hold_an_arm(name: str) -> None:
    assert name in PAGE or name.startswith(("my_expressions", "my_signals"))
    settings = ServoSettings(rate_hz=1000.0, law=name, sensor_channels=(6,))
    rig = LockstepRig(ROBOT, settings, Emulator(ROBOT, start="end", physics="rigid", pots=False))
    prove(rig.law, name, ROBOT, settings.period_ns)
    rig.ticks(1)
    rig.mailbox.request_power(True)
    rig.run_for(0.5)
    snapshot = rig.mailbox.snapshot()
    assert snapshot.mode == Mode.HOLDING
    np.testing.assert_allclose(snapshot.q, ROBOT.poses["end"], atol=0.02)


def test_the_sensor_of_the_page_pushes_the_joint() -> None:
    deployment = tomllib.loads(re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)[0])
    choice = ServoChoice.model_validate(deployment["arm"]["servo"])
    law = find_law(choice.law, ROBOT, choice.law_settings)
    assert choice.sensor_channels == (6,)
    sensors = np.zeros(8)
    without = call(law, q=np.zeros(6), sensors=sensors)
    sensors[6] = 2.5
    np.testing.assert_allclose(call(law, q=np.zeros(6), sensors=sensors) - without, [2.5, 0, 0, 0, 0, 0])


def test_the_arguments_the_page_lists_are_all_there_are() -> None:
    from qrobot.servo.laws.law import ARGUMENTS

    listed = set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`[^|]*) \|", PAGE, re.MULTILINE))))
    assert listed == set(ARGUMENTS) - {"tau"}
