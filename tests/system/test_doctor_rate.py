"""`qrobot doctor --rate` on this machine: the loop runs, and what it shows is told."""

from __future__ import annotations

import json
import re

import pytest

from tests.support.patience import PATIENCE_S
from tests.support.processes import qrobot

pytestmark = pytest.mark.realtime


@pytest.mark.usefixtures("runtime_folder")  # beside a running arm, such as that of other tests, no rate is tried
def test_the_rate_is_judged_by_the_loop_itself() -> None:
    process = qrobot("doctor", "--rate", "--json")
    printed, said = process.communicate(timeout=3 * PATIENCE_S)
    assert "trying the rate of puma560" in said
    findings = json.loads(printed)["findings"]
    [rate] = [finding for finding in findings if (finding["group"], finding["name"]) == ("servo of puma560", "rate")]
    assert re.match(r"\d+ Hz: a cycle takes \d+\.\d µs \(.*% of the period\) and wakes \d+ µs late", rate["detail"])
    assert rate["ok"] or "Hz" in rate["remedy"] or "processor" in rate["remedy"]
