"""The tab Programs of the pendant, while somebody edits what it shows."""

from __future__ import annotations

import pytest

from tests.support.browser import Page, needs_browser, open_browser
from tests.support.patience import wait_until
from tests.support.pendant_process import ONCE, PROGRAM, SOURCE_OF_ONCE, Pendant

pytestmark = [pytest.mark.realtime, needs_browser]

HOLD_SOURCE = """
const ask = window.fetch;
window.fetch = (what, ...more) => {
  if (!String(what).includes("programs/source")) return ask(what, ...more);
  return new Promise((answer) => (window.answer = () => ((window.fetch = ask), answer(ask(what, ...more)))));
};
"""
CAN_START = "return !document.getElementById('start-live').disabled"
STAMP = "return document.getElementById('source').dataset.stamp"


@pytest.mark.thorough
def test_the_source_on_the_page_follows_an_editor_and_what_was_to_be_confirmed_goes(pendant: Pendant) -> None:
    file = pendant.deployment.parent / "programs" / ONCE
    file.write_text(SOURCE_OF_ONCE)
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.click("drive")
        page.click("tab-programs")
        page.click_at(f'[data-name="{ONCE}"]')
        wait_until(lambda: page.shows("#source", "setjvel(0.2)"), "it is shown")
        assert page.run(STAMP) == str(file.stat().st_mtime_ns)
        page.click("start-live")
        wait_until(lambda: page.shows(".confirm", f"as {ONCE} says"), "it waits for a confirmation")
        file.write_text(SOURCE_OF_ONCE.replace("0.2", "0.25"))
        wait_until(lambda: page.shows("#source", "setjvel(0.25)"), "it is shown as it is now")
        wait_until(lambda: page.run(STAMP) == str(file.stat().st_mtime_ns), "it is what Live is about")
        assert not page.shows(".confirm", f"as {ONCE} says")
        assert page.shows('.program[aria-selected="true"]', ONCE)

        page.run(HOLD_SOURCE)
        page.click_at(f'[data-name="{PROGRAM}"]')
        wait_until(lambda: page.run("return Boolean(window.answer)"), "the source is asked for")
        assert not page.run(CAN_START)  # nobody has seen yet what the arm would do
        page.run("window.answer()")
        wait_until(lambda: page.run(CAN_START), "it can be started")
        assert page.shows("#source", "while True")
    file.write_text(SOURCE_OF_ONCE)  # for whoever runs it behind this test
