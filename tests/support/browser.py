"""A real browser, Debian's chromium without a screen, for the pages of the pendant."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import pytest
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.actions.mouse_button import MouseButton

from tests.support.patience import wait_until

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage", "--use-gl=angle",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--force-device-scale-factor=1",
    "--disable-gpu-compositing",
    "--disable-backgrounding-occluded-windows", "--disable-renderer-backgrounding",
)  # fmt: skip
SIZE = (1200, 800)
DRIVER = Path(__file__).with_name("chromedriver")
CLICK = """
const element = document.querySelector(arguments[0]);
if (!element || element.disabled || element.offsetParent === null) return false;
element.scrollIntoView({block: "center"});
const box = element.getBoundingClientRect();
if (!element.contains(document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2))) return false;
element.click();
return true;
"""
SHOWS = """
const shown = [...document.querySelectorAll(arguments[0])].filter((each) => each.offsetParent !== null);
return shown.some((each) => each.innerText.includes(arguments[1]));
"""
CHOOSE = """
const element = document.getElementById(arguments[0]);
element.value = arguments[1];
element.dispatchEvent(new Event("change"));
return element.value === arguments[1];
"""


def chromium() -> str | None:
    """Path of the browser, None where it is not installed."""
    return shutil.which("chromium")


needs_browser = pytest.mark.skipif(
    not (chromium() and shutil.which("chromedriver")) and "CI" not in os.environ,
    reason="no browser: apt install chromium chromium-driver",
)


@contextmanager
def open_browser() -> Iterator[Any]:
    """A browser of its own; whatever happens it is ended."""
    options = Options()
    options.binary_location = chromium() or "chromium"
    for flag in (*FLAGS, f"--window-size={SIZE[0]},{SIZE[1]}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options, Service(str(DRIVER)))
    try:
        yield driver
    finally:
        driver.quit()


class Page:
    """The pendant in a window of a browser. An element is looked up and used at once: any may be drawn anew.

    Args:
        driver: of the browser.
        address: of the pendant.
        window: a window of its own, beside those that there are.
    """

    def __init__(self, driver: Any, address: str, window: bool = False) -> None:
        if window:
            driver.switch_to.new_window("window")
        self._driver, self._window = driver, driver.current_window_handle
        driver.get(address)
        wait_until(lambda: self.run("return window.pendant?.arm?.history.length > 3"), "the page shows the arm")

    def draw_no_more(self) -> None:
        """Leave the arm's picture as it is: without a graphics processor it takes half of what a test takes."""
        self.run("pendant.view.draw = () => (pendant.view.due = false)")

    def run(self, script: str, *arguments: object) -> Any:
        """Result of a script, in its window."""
        return self._in_window().execute_script(script, *arguments)

    def click_at(self, place: str) -> None:
        """Click on the first element of a selector once it can be seen, is not covered, and may be clicked."""
        wait_until(lambda: self.click_if(place), f"a click on {place}")

    def click(self, identity: str) -> None:
        """The same by its id."""
        self.click_at(f"#{identity}")

    def click_if(self, place: str) -> bool:
        """Click on the first element of a selector if that can be done now."""
        return bool(self.run(CLICK, place))

    def choose_option(self, identity: str, value: str) -> bool:
        """Choose an option; False when there is none of that value."""
        return bool(self.run(CHOOSE, identity, value))

    def shows(self, place: str, text: str) -> bool:
        """Something that can be seen at a selector has the text."""
        return bool(self.run(SHOWS, place, text))

    def flag(self, flag: int) -> bool:
        """A flag of the newest sample."""
        return bool(self.run("return pendant.arm.state.flags") & flag)

    def press(self, button: int | str) -> None:
        """Press a button and keep it down: by its number among those to hold, or by its id."""
        wait_until(lambda: self._pressed(button), f"button {button} is pressed")

    def touch(self, place: str) -> None:
        """Press the button of the mouse at the first element of a selector, and keep it down."""
        found = self._in_window().find_element("css selector", place)
        ActionChains(self._driver, duration=0).click_and_hold(found).perform()

    def let_go(self) -> None:
        """Let go of what is pressed."""
        ActionChains(self._in_window(), duration=0).release().perform()

    def let_go_with_the_right_button_down(self) -> None:
        """Press the right button of the mouse as well, and let go of the left one alone."""
        hand = ActionBuilder(self._in_window(), duration=0)
        hand.pointer_action.pointer_down(MouseButton.RIGHT).pointer_up(MouseButton.LEFT)
        hand.perform()

    def let_go_of_the_right_button(self) -> None:
        """The same of that one."""
        hand = ActionBuilder(self._in_window(), duration=0)
        hand.pointer_action.pointer_up(MouseButton.RIGHT)
        hand.perform()

    def key(self, way: Literal["Down", "Up"], name: str, modifiers: int = 0, repeat: bool = False) -> None:
        """A key of the keyboard goes down or up, under the name that its layout gives it now.

        Args:
            way: of the key.
            name: `key` of the event.
            modifiers: that are down, a sum of 1 Alt, 2 Ctrl, 4 Meta and 8 Shift.
            repeat: it is still down.
        """
        told = {"type": f"key{way}", "key": name, "modifiers": modifiers, "autoRepeat": repeat}
        self._in_window().execute_cdp_cmd("Input.dispatchKeyEvent", told)

    def type(self, keys: str) -> None:
        """Type at no field."""
        self._in_window().find_element("tag name", "body").send_keys(keys)

    def window_picture(self) -> bytes:
        """What the window shows, as PNG."""
        return bytes(self._in_window().get_screenshot_as_png())

    def picture(self, place: str) -> bytes:
        """An element as PNG."""
        return bytes(self._in_window().find_element("css selector", place).screenshot_as_png)

    def complaints(self) -> list[str]:
        """Errors that the browser has found."""
        return [entry["message"] for entry in self._in_window().get_log("browser") if entry["level"] == "SEVERE"]

    def _in_window(self) -> Any:
        if self._driver.current_window_handle != self._window:
            self._driver.switch_to.window(self._window)
        return self._driver

    def _pressed(self, button: int | str) -> bool:
        place = f"#{button}" if isinstance(button, str) else ".hold"
        try:
            found = self._in_window().find_elements("css selector", place)[button if isinstance(button, int) else 0]
            self.run("arguments[0].scrollIntoView({block: 'center'})", found)
            ActionChains(self._driver, duration=0).click_and_hold(found).perform()
        except (StaleElementReferenceException, IndexError):
            return False
        return True
