"""The pendant in a real browser, against the processes of a running arm."""

from __future__ import annotations

import http.client
import io
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from qrobot.config import load_deployment, load_robot
from qrobot.fences.fence_set import fences_of
from qrobot.hwif.board_memory import PANEL_MICRO, attach_board_memory
from qrobot.modecodes import Mode
from qrobot.pendant.gate import cookie_name
from tests.support.browser import open_browser
from tests.support.patience import PATIENCE_S, give_time, wait_until
from tests.support.processes import RunningArm, free_port, qrobot

pytestmark = pytest.mark.realtime

FAR_RAD = 0.02
LOOKS_BEFORE_ANOTHER_PRESS = 5
STILL_S = 0.4
PROGRAM = "01_park_and_return.py"
EXAMPLES = Path(__file__).parents[2] / "examples"
STALL_MS = 700
PLUS_OF_JOINT_1 = 1  # of the buttons to hold
TOOL_COLOUR = (192, 57, 43)  # of the marker at the tool's tip
AROUND_PX = 14
ELBOW, LEADING_N_M, LED_RAD, LED_S = 2, 12.0, 0.03, 1.5  # friction holds a PUMA against less


FENCES = """
[arm.fences]
self_collision = true
shape = [
  { name = "bench", shape = "box", size_m = [0.6, 1.2, 0.1], position_m = [0.6, 0.0, -0.35], rpy_deg = [20, 5, 0] },
  { name = "pole", shape = "cylinder", radius_m = 0.1, length_m = 0.6, position_m = [0.4, 0.5, 0.2], bodies = "links" },
  { name = "cell", shape = "box", keep = "in", bodies = "tool", size_m = [1.6, 1.8, 2.4] },
  { name = "window", shape = "plane", position_m = [0.9, 0.0, 0.0], rpy_deg = [0, -90, 0] },
]
"""


class Pendant:
    """`qrobot pendant` of two arms, and what its address tells.

    The servo of the first one does not know its fences; the second one is not there.
    """

    def __init__(self, arm: RunningArm, folder: Path) -> None:
        self.deployment = folder / "two.toml"
        table = Path(arm.deployment).read_text()
        absent = table.replace(arm.name, "absent").replace(str(arm.arm.bridge.port), str(free_port()))
        self.deployment.write_text(table + FENCES + absent)
        self.process = qrobot(
            "pendant", "--deployment", self.deployment, "--port", "0", "--taught", folder / "t.db",
            "--programs", EXAMPLES, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        self.host, _, query = self.address.removeprefix("http://").partition("/?")
        token = query.removeprefix("token=")
        self.cookie = f"{cookie_name(token)}={token}"

    def status_of(self, path: str, **headers: str) -> int:
        """Status with which a request is answered."""
        connection = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        connection.request("GET", path, headers={"Host": self.host, **headers})
        status = connection.getresponse().status
        connection.close()
        return status

    def status_of_socket(self, path: str, origin: str, cookie: str) -> int:
        """The same of a WebSocket; 101 when it opens."""
        try:
            with connect(f"ws://{self.host}{path}", origin=origin, additional_headers={"Cookie": cookie}):  # type: ignore[arg-type]
                return 101
        except InvalidStatus as refusal:
            return refusal.response.status_code


class Page:
    """A browser with the pendant's page in it."""

    def __init__(self, driver: Any, address: str) -> None:
        self.driver = driver
        driver.get(address)
        wait_until(lambda: self.run("return window.pendant?.arm?.history.length > 3"), "the page shows the arm")

    def run(self, script: str) -> Any:
        return self.driver.execute_script(script)

    def click(self, identity: str) -> None:
        wait_until(lambda: self.driver.find_element("id", identity).is_enabled(), identity)
        self.driver.find_element("id", identity).click()

    def choose_option(self, identity: str, value: str) -> None:
        element = f"document.getElementById('{identity}')"
        self.run(f"{element}.value = '{value}'; {element}.dispatchEvent(new Event('change'))")

    def drive(self) -> None:
        """Take the lease and the arm."""
        self.click("drive")
        wait_until(lambda: self.run("return pendant.driving"), "this page drives")
        self.take()

    def take(self) -> None:
        """Take the arm."""
        self.click("take")
        wait_until(lambda: self.run("return pendant.ready"), "the arm follows")

    def take_to_lead(self) -> None:
        """Take the lease, and the arm to lead it by hand, unless it has both: a page that stalls loses them."""
        if not self.run("return pendant.driving"):
            self.click("drive")
            wait_until(lambda: self.run("return pendant.driving"), "this page drives")
        if not self.run("return pendant.leading"):
            self.click("guide-take")
            wait_until(lambda: self.run("return pendant.leading"), "the arm can be led")

    def choose_arm(self, number: int) -> None:
        self.driver.find_element("css selector", f'[data-arm="{number}"]').click()
        wait_until(lambda: self.run("return pendant.chosen") == number, "the page is about it")

    @property
    def drivers(self) -> Any:
        """Which page drives each arm."""
        return self.run("return pendant.status.arms.map((arm) => arm.driver)")

    def shows(self, place: str, text: str) -> bool:
        """Something at this place has the text."""
        return any(text in each.text for each in self.driver.find_elements("css selector", place))

    @property
    def program(self) -> Any:
        """What the page knows of the program that was started last."""
        return self.run("return pendant.armStatus.program")

    def choose(self, program: str) -> None:
        """Choose a program of the list; its source is shown."""
        place = f'[data-name="{program}"]'
        wait_until(lambda: self.driver.find_elements("css selector", place), "programs are listed")
        self.driver.find_element("css selector", place).click()
        wait_until(lambda: "rccl" in self.driver.find_element("id", "source").text, "its source")

    def press(self) -> None:
        button = self.driver.find_elements("css selector", ".hold")[PLUS_OF_JOINT_1]
        ActionChains(self.driver).click_and_hold(button).perform()

    def let_go(self) -> None:
        ActionChains(self.driver).release().perform()


@pytest.fixture
def pendant(arm: RunningArm, tmp_path: Path) -> Iterator[Pendant]:
    arm.wait_for_rest()
    pendant = Pendant(arm, tmp_path)
    yield pendant
    pendant.process.send_signal(signal.SIGINT)
    pendant.process.communicate(timeout=PATIENCE_S)


def press_until_it_moves(page: Page, arm: RunningArm) -> None:
    """Press anew whenever the arm stays at rest: a page that stalls on a busy machine ends its press, as it should.

    When the process that moves the arm stalls, the arm has to be taken anew as well.
    """
    began = arm.snapshot().q[0]
    page.press()

    def far() -> bool:
        if all(is_at_rest(arm) for _ in range(LOOKS_BEFORE_ANOTHER_PRESS)):
            page.let_go()
            if page.run("return pendant.armStatus.session === 'no'"):
                page.take()
            page.press()
        return bool(arm.snapshot().q[0] > began + FAR_RAD)

    wait_until(far, "the arm moves")


def is_at_rest(arm: RunningArm) -> bool:
    before = arm.snapshot().q_setpoint[0]
    give_time(STILL_S)
    return bool(arm.snapshot().q_setpoint[0] == before)


def test_an_arm_is_driven_from_one_page_and_a_page_that_stalls_or_dies_moves_it_no_longer(
    arm: RunningArm, pendant: Pendant
) -> None:
    with open_browser() as driver, open_browser() as other:
        page = Page(driver, pendant.address)
        assert page.driver.current_url.startswith(f"http://{pendant.host}/#")  # the token has left the address
        the_arm_is_seen_where_its_kinematics_says(page)
        the_page_knows_how_far_off_each_fence_is(page, pendant)
        every_tab_opens(page)
        a_log_is_opened_while_it_is_written(page)
        page.drive()
        the_scope_waits_for_a_motion(page)
        press_until_it_moves(page, arm)
        page.let_go()
        wait_until(lambda: is_at_rest(arm), "at rest once it is let go")
        every_cycle_of_the_motion_is_kept(page)

        watcher = Page(other, pendant.address)
        assert not watcher.run("return pendant.driving")
        assert not other.find_element("id", "drive").is_enabled()
        watcher.run("pendant.say({do: 'press', arm: 0, number: 99, target: 'joint', name: '1'})")
        assert is_at_rest(arm)
        each_arm_has_a_lease_that_is_taken_and_given_up(page, watcher)
        the_arm_is_led_by_hand_while_its_button_is_held(page, arm)
        page.take()

        press_until_it_moves(page, arm)
        page.run(f"const t = performance.now(); while (performance.now() - t < {STALL_MS});")
        assert page.run("return pendant.press !== null")  # the button is still down
        wait_until(lambda: is_at_rest(arm), "at rest since the page stalled")
        give_time(STILL_S)
        assert is_at_rest(arm)
        page.let_go()

        press_until_it_moves(page, arm)
        watcher.driver.find_element("tag name", "body").send_keys(Keys.ESCAPE)  # anybody may stop
        arm.wait_for(Mode.HOLDING)
        wait_until(lambda: page.run("return pendant.armStatus.session === 'no'"), "the page is told")
        wait_until(lambda: "to go on" in page.run("return pendant.armStatus.notice"), "what happened, and what to do")
        page.let_go()

        page.take()
        press_until_it_moves(page, arm)
        os.kill(driver.capabilities["goog:processID"], signal.SIGKILL)
        wait_until(lambda: is_at_rest(arm), "at rest since the browser has gone")
        a_program_is_paused_while_no_page_drives_and_ended_by_stop(arm, watcher)


def each_arm_has_a_lease_that_is_taken_and_given_up(page: Page, other: Page) -> None:
    """Two browsers, and a second arm that is not there; at the end nobody drives the first one."""
    first, second = (each.run("return pendant.page") for each in (page, other))
    assert page.run("return pendant.view.figures.length") == 2
    other.choose_arm(1)
    other.click("drive")
    wait_until(lambda: page.drivers == other.drivers == [first, second], "each drives an arm")
    wait_until(lambda: page.shows('[data-arm="1"]', f"page {second} drives"), "it is shown")
    page.click("drive")  # gives up
    other.choose_arm(0)
    other.click("drive")
    wait_until(lambda: page.drivers == other.drivers == [second, second], "the other page drives both")
    assert page.run("return pendant.hold('joint', '1', {})") is False
    other.click("drive")
    wait_until(lambda: page.drivers == [None, second], "the first arm is free")


def the_arm_is_led_by_hand_while_its_button_is_held(page: Page, arm: RunningArm) -> None:
    """A push at the emulated arm is the hand; at the end `page` drives, and has let go of the arm."""
    page.take_to_lead()
    assert page.run("return pendant.hold('joint', '1', {})") is False
    began = arm.snapshot().q[ELBOW]
    button = page.driver.find_element("id", "guide-hold")
    with attach_board_memory(arm.name) as board:
        board.memory.panel.push[ELBOW] = round(LEADING_N_M * PANEL_MICRO)
        while arm.snapshot().q[ELBOW] < began + LED_RAD:  # a page that stalls leads it no longer: press anew
            page.take_to_lead()
            ActionChains(page.driver).click_and_hold(button).perform()
            give_time(LED_S)
            page.let_go()
        wait_until(lambda: is_at_rest(arm), "it is held although the hand pushes on")
        board.memory.panel.push[ELBOW] = 0
    page.take_to_lead()
    page.click("guide-place")
    wait_until(lambda: page.run("return 'P1' in pendant.armStatus.taught"), "the place is kept")
    page.click("guide-take")
    page.click("guide-write")
    wait_until(lambda: "qrobot replay" in page.run("return pendant.armStatus.notice"), "the recording is written")
    page.run("window.scrollTo(0, 0)")  # from below the bar


def a_program_is_paused_while_no_page_drives_and_ended_by_stop(arm: RunningArm, page: Page) -> None:
    page.click("drive")
    wait_until(lambda: page.run("return pendant.driving && pendant.armStatus.session === 'no'"), "this page drives")
    page.click("tab-programs")
    page.choose(PROGRAM)
    page.click("start-live")
    assert page.program["state"] == "none"  # it waits for a confirmation
    page.click("start-sure")
    wait_until(lambda: arm.mode is Mode.TRACKING, "the program moves the arm")
    page.click("drive")  # gives up
    wait_until(lambda: page.run("return pendant.arm.state.flags & 64"), "motions are paused")
    wait_until(lambda: is_at_rest(arm), "it stands on its path")
    assert page.program["state"] == "running"
    page.click("drive")
    page.click("program-pause")
    wait_until(lambda: not is_at_rest(arm), "it goes on")
    page.driver.find_element("tag name", "body").send_keys(Keys.ESCAPE)
    arm.wait_for(Mode.HOLDING)
    wait_until(lambda: page.program["state"] == "ended", "the program has ended")


def every_tab_opens(page: Page) -> None:
    shown = {
        "programs": (".program", PROGRAM),
        "board": ("#board-facts", "revision"),
        "calibrate": ("#procedure-state", "nothing"),
    }
    for tab in ("scope", "teach", "programs", "board", "calibrate", "drive"):
        page.click(f"tab-{tab}")
        wait_until(lambda tab=tab: page.driver.find_element("css selector", f".pane-{tab}").is_displayed(), tab)
        place, text = shown.get(tab, (f".pane-{tab}", ""))
        wait_until(lambda place=place, text=text: page.shows(place, text), f"{tab} shows {text}")
    complaints = [entry["message"] for entry in page.driver.get_log("browser") if entry["level"] == "SEVERE"]
    assert complaints == []
    asked = page.run("return performance.getEntriesByType('resource').map((entry) => new URL(entry.name).host)")
    assert set(asked) == {page.run("return location.host")}


def the_scope_waits_for_a_motion(page: Page) -> None:
    page.click("tab-scope")
    page.choose_option("scope-source", "ring")
    wait_until(lambda: page.shows("#scope-about", "cycles"), "every cycle is shown")
    page.choose_option("trigger", "velocity")
    page.run("document.getElementById('trigger-level').value = '1'")
    page.click("trigger-arm")
    page.click("tab-drive")


def every_cycle_of_the_motion_is_kept(page: Page) -> None:
    page.click("tab-scope")
    wait_until(lambda: page.shows("#trigger-told", "triggered"), "the trigger has seen the motion")
    wait_until(lambda: page.shows("#freeze", "Go on"), "it is frozen")
    assert not page.driver.find_element("id", "scope-problem").is_displayed()
    page.click("tab-drive")


def a_log_is_opened_while_it_is_written(page: Page) -> None:
    page.click("tab-logs")
    wait_until(lambda: page.driver.find_elements("css selector", ".pane-logs .entry[data-name]"), "the logs are listed")
    page.driver.find_element("css selector", ".pane-logs .entry[data-name]").click()
    wait_until(lambda: "1000 Hz" in page.driver.find_element("id", "log-about").text, "the log is open")
    assert len(page.driver.find_elements("css selector", ".pane-logs .uplot")) == 2  # error and position
    assert not page.driver.find_element("id", "log-problem").is_displayed()
    page.click("tab-drive")


def the_arm_is_seen_where_its_kinematics_says(page: Page) -> None:
    """The marker of the tool is in the picture where forward kinematics and camera put it."""
    give_time(STILL_S)
    page.run("pendant.view.draw()")
    x, y = page.run("return pendant.tipOnScreen()")
    canvas = page.driver.find_element("css selector", ".scene canvas")
    picture = np.asarray(Image.open(io.BytesIO(canvas.screenshot_as_png)).convert("RGB")).astype(int)
    off = np.abs(picture - TOOL_COLOUR).max(axis=2)
    rows, columns = np.nonzero(off < 12)
    assert rows.size > 5
    height, width = off.shape
    assert np.hypot(columns.mean() - x * width, rows.mean() - y * height) < AROUND_PX


def the_page_knows_how_far_off_each_fence_is(page: Page, pendant: Pendant) -> None:
    """To a millimetre, for it looks at points of the arm; and it says which is the first."""
    robot = load_robot("puma560")
    fences = fences_of(load_deployment(pendant.deployment).arm[0], robot)
    assert fences is not None
    for q in robot.poses.values():
        near = {each.fence: each for each in fences.nearness(q)}
        asked = f"return pendant.view.figures[0].fences.nearness({q.tolist()})"
        for told in page.run(asked):
            assert told["distance"] == pytest.approx(near[told["fence"]].distance, abs=1e-3)
        assert len(near) == 5
    assert page.shows(".scene .nearest", "mm off")


def test_a_foreign_page_or_host_or_no_token_is_refused_by_page_socket_io_and_live_socket(pendant: Pendant) -> None:
    own, evil = f"http://{pendant.host}", "http://evil.example"
    polling = "/_nicegui_ws/socket.io/?EIO=4&transport=polling"
    for path in ("/", polling, "/ask/programs?arm=0"):
        assert pendant.status_of(path, Cookie=pendant.cookie, Origin=own) != 403
        assert pendant.status_of(path, Cookie=pendant.cookie, Origin=evil) == 403
        assert pendant.status_of(path, Cookie=pendant.cookie, Host="evil.example") == 403
        assert pendant.status_of(path) == 403
    for path in ("/live", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"):
        assert pendant.status_of_socket(path, own, pendant.cookie) == 101
        assert pendant.status_of_socket(path, evil, pendant.cookie) == 403
        assert pendant.status_of_socket(path, own, pendant.cookie.replace("=", "=guess")) == 403
