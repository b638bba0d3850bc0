"""A page of the pendant that is about another arm than before: nothing of that one is left, and nothing of it comes."""

from __future__ import annotations

from typing import Final

import pytest

from tests.support.browser import Page, needs_browser, open_browser
from tests.support.patience import give_time, wait_until
from tests.support.pendant_process import Pendant
from tests.system.test_pendant import choose_arm

pytestmark = [pytest.mark.realtime, needs_browser]

FAULT: Final = {"fault": "stuck of one", "over": False, "steps": 1, "acted": 1}
BOARD: Final = {
    "revision": "revision of one", "count": 1, "period_ms": 1, "t_s": 1.0, "faults": [FAULT],
    "registers": [{"name": "ENC_1", "offset": 0, "word": 0xBEEF, "told": "counter of one"}],
    "bits": [{"register": "STATUS", "bit": 0, "name": "bit of one", "on": True}],
    "modules": [{"name": "module of one", "lines": ["line of one"]}], "counters": {"counted of one": 4711},
}  # fmt: skip
SEEN: Final = {"emulated": True, "problem": "problem of one", "board": BOARD, "kinds": []}
OUTPUT: Final = {"first": 0, "results": []}
ANSWERS: Final = {
    "load": {"mass": 98.76, "reaction": "stop", "thresholds": ["threshold of one"]},
    "board": SEEN,
    "programs/output": OUTPUT | {"lines": ["printed of one"]},
    "procedure": OUTPUT | {"lines": ["found of one"]},
}
MARKS: Final = {
    "drive": ["98.76", "threshold of one"],
    "board": [
        "revision of one", "counter of one", "bit of one", "module of one", "line of one", "counted of one",
        "stuck of one", "problem of one",
    ],
    "programs": ["printed of one"],
    "calibrate": ["found of one"],
}  # fmt: skip
FAKE_ANSWERS = """
const [answers] = arguments, truly = window.fetch;
window.held = [];
window.holds = false;
window.fetch = async (address, ...more) => {
  const url = new URL(address, location), what = url.pathname.replace("/ask/", "");
  if (!(what in answers)) return truly(address, ...more);
  const arm = url.searchParams.get("arm");
  if (window.holds || arm !== "0") await new Promise((go) => held.push([arm, go]));
  const {program, procedure} = pendant.status.arms[Number(arm)]; // tests before this one may have run some
  const run = { "programs/output": program?.run ?? 0, procedure: procedure?.run ?? 0 }[what];
  return new Response(JSON.stringify({ ...answers[what], run }));
};
"""
SHOWN = "return arguments[0].filter((mark) => document.body.textContent.includes(mark))"
LEAVE = """
document.getElementById("force-input-3").checked = true;
document.getElementById("program-trace").hidden = false;
"""
LEFT = """
return [document.getElementById("force-input-3").checked, !document.getElementById("program-trace").hidden];
"""
HOLD = "window.holds = true; held.length = 0"
LET_COME = """
window.holds = false;
for (const [arm, go] of held.splice(0)) arguments[0].includes(arm) ? go() : held.push([arm, go]);
"""


def nothing_of_an_arm_stays_when_another_one_is_chosen_and_nothing_comes_late(page: Page, marks: list[str]) -> None:
    wait_until(lambda: page.run(SHOWN, marks) == marks, "all of it is shown")
    page.run(HOLD)
    wait_until(lambda: page.run("return held.length > 0"), "the page has asked about the first arm")
    page.run(LEAVE)
    assert page.run(f"pendant.choose(1); {SHOWN}", marks) == []
    assert page.run(LEFT) == [False, False]
    page.run(LET_COME, ["0"])
    give_time()
    assert page.run(SHOWN, marks) == []
    choose_arm(page, 0)
    page.run(LET_COME, ["0", "1"])
    wait_until(lambda: page.run(SHOWN, marks) == marks, "it is shown again")


@pytest.mark.thorough
def test_a_page_shows_what_it_has_asked_about_the_chosen_arm_and_about_no_other_one(pendant: Pendant) -> None:
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.run(FAKE_ANSWERS, ANSWERS)
        for tab, marks in MARKS.items():
            page.click(f"tab-{tab}")
            nothing_of_an_arm_stays_when_another_one_is_chosen_and_nothing_comes_late(page, marks)
