"""Buttons of the pendant with two meanings: what is asked for when the meaning changes under the finger."""

from __future__ import annotations

import pytest

from tests.support.browser import Page, needs_browser, open_browser
from tests.support.patience import wait_until
from tests.support.pendant_process import Pendant
from tests.support.processes import RunningArm

pytestmark = [pytest.mark.realtime, needs_browser]

FREE = "{driver: pendant.page, session: 'no', commanded: false}"
JOGGED = "{driver: pendant.page, session: 'ready', guide: false}"
LED = "{driver: pendant.page, session: 'ready', guide: true}"
CASES = {  # what is told of the arm while the button gives it less, and while it gives it more
    "take": (f"tell({JOGGED})", f"tell({FREE})"),
    "guide-take": (f"tell({LED})", f"tell({FREE})"),
    "drive": (f"tell({FREE})", "tell({driver: null, session: 'no'})"),
    "pause": (f"flags(0); tell({FREE})", f"flags(64); tell({FREE})"),
}
TELL_AND_LISTEN = """
pendant.socket.onmessage = () => (pendant.quiet = 0);
pendant.fresh = () => true;
window.said = [];
pendant.say = (message) => {
  if (message.do !== "alive") said.push(message);
  return true;
};
window.tell = (changes) => {
  const status = structuredClone(pendant.status);
  Object.assign(status.arms[0], changes);
  pendant.hear(status);
};
window.more = () => said.filter((each) => each.do === "take" || each.on || each.name === "resume").length;
window.less = () => said.filter((each) => each.do === "give" || each.on === false || each.name === "pause").length;
window.down = (button) => button.dispatchEvent(new PointerEvent("pointerdown", { bubbles: true }));
window.press = (button) => (down(button), button.click());
window.flags = (flags) => (pendant.arms[0].state.flags = flags);
"""
CHANGES_UNDER_THE_FINGER = """
const button = document.getElementById(arguments[0]);
press(button);
const asked = less();
down(button);
{more}
button.click(); // goes up
press(button); // the second one of two, or somebody who was under way
return [asked, more()];
"""


def test_a_button_whose_meaning_changes_under_the_finger_never_gives_the_arm_more(
    arm: RunningArm, pendant: Pendant
) -> None:
    arm.wait_for_rest()
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        rests = "return pendant.status !== null && ['OFF', 'HOLDING'].includes(pendant.modeOf(pendant.arm.state))"
        wait_until(lambda: page.run(rests), "the page knows how things stand")
        page.run(TELL_AND_LISTEN)
        for button, (less, more) in CASES.items():
            usable = f"return !document.getElementById('{button}').disabled"
            page.run(f"{less}; said.length = 0")
            wait_until(lambda usable=usable: page.run(usable), f"{button} can be pressed")
            told = page.run(CHANGES_UNDER_THE_FINGER.replace("{more}", more), button)
            assert told == [1, 0], button
            wait_until(lambda button=button: asks_for_more(page, button), f"{button} asks for what it has long shown")


def asks_for_more(page: Page, button: str) -> bool:
    """A click has asked for what gives the arm more."""
    return page.click_if(f"#{button}") and page.run("return more()") == 1


@pytest.mark.thorough
def test_a_key_that_is_held_on_such_a_button_presses_it_once(pendant: Pendant) -> None:
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        enter = "{key: 'Enter', cancelable: true, bubbles: true, repeat: %s}"
        press = "return document.getElementById(arguments[0]).dispatchEvent(new KeyboardEvent('keydown', %s))"
        for button in CASES:
            assert page.run(press % (enter % "false"), button)
            assert not page.run(press % (enter % "true"), button)  # else the browser clicks
