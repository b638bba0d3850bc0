"""The pendant in a real browser, against the processes of a running arm."""

from __future__ import annotations

import io
import os
import re
import signal
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from PIL import Image
from selenium.webdriver.common.keys import Keys

from qrobot.config import load_deployment, load_robot
from qrobot.fences.fence_set import fences_of
from qrobot.hwif.board_memory import PANEL_MICRO, attach_board_memory
from qrobot.modecodes import Mode
from qrobot.model.arm import Arm
from qrobot.pendant.held_press import PATIENCE_S as PRESS_PATIENCE_S
from qrobot.servo.checks.hold_to_run import PATIENCE_NS
from qrobot.servo.operator.client import ServoClient
from qrobot.wire.vocabulary import RobotFlag
from tests.support.browser import Page, needs_browser, open_browser
from tests.support.patience import give_time, wait_until
from tests.support.pendant_process import ONCE, PROGRAM, Pendant
from tests.support.processes import RunningArm
from tests.support.relay import Relay
from tests.support.shared_arm import SharedArm
from tests.support.stall_watch import StreamLostError, unless_stalled

pytestmark = pytest.mark.realtime

FAR_RAD, FAR_M = 0.02, 0.008
LOOKS_BEFORE_ANOTHER_PRESS = 8
STILL_S = 0.25
RESTS_S = 1.25  # a finger on a slider, while the page hears of the arm many times
STALL_MS = 700
PLUS_OF_JOINT_1, PLUS_OF_X = 1, 13  # of the buttons to hold: two a joint, then two an axis
TABLE = [400.0, 0.0, 0.0, 90.0, 0.0, 0.0]  # its x axis is y of the base
THERE_AND_BACK = """
const ahead = pendant.view.figures[0].ahead, waist = (q) => Float32Array.of(q, 0, 0, 0, 0, 0), left = [];
const way = Array.from({ length: 201 }, (_, k) => waist(1 - Math.abs(k - 100) / 100));
ahead.load({ samples: way.length, joints: 6, sample: (k) => way[k] });
for (const q of arguments[0]) ahead.follow(waist(q)), left.push(ahead.points);
ahead.forget();
return left;
"""
NOTE_NOTICES = """
const notice = document.getElementById("notice");
window.noticed = [];
const changes = { childList: true, characterData: true, subtree: true };
new MutationObserver(() => noticed.push(notice.textContent)).observe(notice, changes);
"""
COUNT_LOOKS = """
window.looks = 0;
new PerformanceObserver((seen) => {
  looks += seen.getEntries().filter((entry) => entry.name.includes("/ask/scope/look")).length;
}).observe({ type: "resource" });
"""
WAS_NOTICED = "return noticed.some((text) => text.includes(arguments[0]))"
IS_HELD = "return pendant.press !== null"
ALT, CTRL, META, SHIFT = 1, 2, 4, 8
ENDS_OF_A_HELD_KEY: tuple[Callable[[Page], None], ...] = (
    *(partial(Page.key, way="Up", name=name) for name in (".", ">", ":", ";", ",", "Enter", "Shift")),
    *(partial(Page.key, way="Down", name=name) for name in ("Shift", "Control", "Alt", "Meta", "AltGraph", "x", "Tab")),
    partial(Page.touch, place=".scene canvas"),
)
TOOL_COLOUR = (192, 57, 43)  # of the marker at the tool's tip
AROUND_PX = 14
SLOW_PICTURE = """
const {view} = pendant, {render} = view.renderer;
pendant.drawn = [];
view.renderer.render = (...all) => {
  const began = performance.now();
  pendant.drawn.push(began);
  while (performance.now() < began + 100);
  render.apply(view.renderer, all);
};
const due = setInterval(() => (view.due = true), 5);
pendant.quick = () => {
  clearInterval(due);
  view.renderer.render = render;
};
"""
ELBOW, LEADING_N_M, LED_RAD, LED_S = 2, 12.0, 0.03, 1.5  # friction holds a PUMA against less


def drive(page: Page) -> None:
    """Take the lease and the arm."""
    page.click("drive")
    wait_until(lambda: page.run("return pendant.driving"), "this page drives")
    take(page)


def take(page: Page) -> None:
    """Take the arm, and before it the lease, or a fault away: a machine that stalls may have cost either."""

    def taken() -> bool:
        if page.run("return pendant.ready"):
            return True
        if not page.run("return pendant.driving"):
            page.click_if("#drive")
        if page.run("return pendant.armStatus.session === 'no'"):
            page.click_if("#clear")
            page.click_if("#take")
        give_time(STILL_S)
        return False

    wait_until(taken, "the arm follows")


def take_to_lead(page: Page) -> None:
    """Take the lease, and the arm to lead it by hand, unless it has both: a page that stalls loses them."""
    if not page.run("return pendant.driving"):
        page.click("drive")
        wait_until(lambda: page.run("return pendant.driving"), "this page drives")

    def leads() -> bool:
        if page.run("return pendant.armStatus.session === 'no'"):  # else the button lets go of the arm again
            page.click_if("#guide-take:not([data-on])")
            give_time(STILL_S)
        return bool(page.run("return pendant.leading"))

    wait_until(leads, "the arm can be led")


def let_go_of_the_led_arm(page: Page) -> None:
    """Unless it was lost already: the same button would take it again."""

    def free() -> bool:
        page.click_if("#guide-take[data-on]")
        give_time(STILL_S)
        return bool(page.run("return pendant.armStatus.session === 'no'"))

    wait_until(free, "nothing has the arm")


def choose_arm(page: Page, number: int) -> None:
    page.click_at(f'[data-arm="{number}"]')
    wait_until(lambda: page.run("return pendant.chosen") == number, "the page is about it")


def drivers(page: Page) -> object:
    """Which page drives each arm."""
    return page.run("return pendant.status.arms.map((arm) => arm.driver)")


def state_of_program(page: Page) -> object:
    """Of the program that was started last, as the page knows it."""
    return page.run("return pendant.armStatus.program.state")


def press_joint_1(page: Page) -> None:
    page.press(PLUS_OF_JOINT_1)


def press_until(
    page: Page,
    arm: RunningArm,
    far: Callable[[], bool],
    press: Callable[[Page], None] = press_joint_1,
    let_go: Callable[[Page], None] = Page.let_go,
) -> None:
    """Press anew whenever the arm stays at rest: a page that stalls on a busy machine ends its press, as it should.

    When the process that moves the arm stalls, the arm has to be taken anew as well.
    """
    press(page)

    def comes() -> bool:
        if not far() and all(is_at_rest(arm) for _ in range(LOOKS_BEFORE_ANOTHER_PRESS)):
            let_go(page)
            if page.run("return pendant.armStatus.session === 'no'"):
                take(page)
            press(page)
        return far()

    wait_until(comes, "the arm moves")


def press_until_it_moves(page: Page, arm: RunningArm) -> None:
    began = arm.snapshot().q[0]
    press_until(page, arm, lambda: bool(arm.snapshot().q[0] > began + FAR_RAD))


def is_at_rest(arm: RunningArm) -> bool:
    before = arm.snapshot().q_setpoint.copy()
    give_time(STILL_S)
    return bool((arm.snapshot().q_setpoint == before).all())


@pytest.mark.thorough
@needs_browser
def test_a_page_shows_the_arm_every_tab_a_log_that_is_written_and_curves_of_a_motion(
    arm: RunningArm, shared_arm: SharedArm, pendant: Pendant
) -> None:
    shared_arm.park()  # elsewhere the marker of the tool may not be seen
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        the_arm_is_seen_where_its_kinematics_says(page)
        a_picture_that_takes_long_is_drawn_less_often(page)
        page.draw_no_more()
        every_tab_opens(page)
        the_path_ahead_of_one_that_returns_is_not_cut_short(page)
        a_log_is_opened_while_it_is_written(page)
        drive(page)
        the_scope_waits_for_a_motion(page)
        press_until_it_moves(page, arm)
        page.let_go()
        wait_until(lambda: is_at_rest(arm), "at rest once it is let go")
        every_cycle_of_the_motion_is_kept(page)
        the_tool_goes_along_the_axes_of_a_taught_place(page, arm)
        a_trigger_is_for_what_comes_and_not_for_what_was(page)


@needs_browser
def test_an_arm_is_driven_from_one_page_and_a_page_that_stalls_or_dies_moves_it_no_longer(
    arm: RunningArm, pendant: Pendant
) -> None:
    host, port = pendant.host.split(":")
    with Relay((host, int(port))) as relay, open_browser() as driver:
        page = Page(driver, pendant.address_by(relay))
        the_page_knows_how_far_off_each_fence_is(page, pendant)
        page.draw_no_more()
        assert page.run("return location.href").startswith(f"http://127.0.0.1:{relay.port}/#")  # without the token
        drive(page)
        press_until_it_moves(page, arm)
        page.let_go()
        wait_until(lambda: is_at_rest(arm), "at rest once it is let go")

        watcher = Page(driver, f"{pendant.address}#teach", window=True)
        watcher.draw_no_more()
        assert not watcher.run("return pendant.driving")
        wait_until(lambda: tells_who_drives(watcher, page), "the second page says who drives")
        watcher.run("pendant.say({do: 'press', arm: 0, number: 99, target: 'joint', name: '1'})")
        assert is_at_rest(arm)
        each_arm_has_a_lease_that_is_taken_and_given_up(page, watcher)
        the_arm_is_led_by_hand_while_its_button_is_held(page, arm)
        a_program_is_paused_while_no_page_drives_led_back_to_its_path_and_ended_by_stop(arm, page)

        take(page)
        press_until_it_moves(page, arm)
        page.run(f"const t = performance.now(); while (performance.now() - t < {STALL_MS});")
        assert page.run("return pendant.press !== null")  # the button is still down
        wait_until(lambda: is_at_rest(arm), "at rest since the page stalled")
        assert is_at_rest(arm)
        page.let_go()

        the_arm_is_braked_when_the_network_is_cut_and_moves_with_another_press_alone(page, watcher, arm, relay)

        press_until_it_moves(page, arm)
        watcher.type(Keys.ESCAPE)  # anybody may stop
        arm.wait_for(Mode.HOLDING)
        wait_until(lambda: page.run("return pendant.armStatus.session === 'no'"), "the page is told")
        wait_until(lambda: "to go on" in page.run("return pendant.armStatus.notice"), "what happened, and what to do")
        page.let_go()

        take(page)
        press_until_it_moves(page, arm)
        os.kill(driver.capabilities["goog:processID"], signal.SIGKILL)
        wait_until(lambda: is_at_rest(arm), "at rest since the browser has gone")


def the_tool_goes_along_the_axes_of_a_taught_place(page: Page, arm: RunningArm) -> None:
    page.run(f"pendant.say({{do: 'place', arm: 0, name: 'TABLE', numbers: {TABLE}}})")
    wait_until(lambda: page.choose_option("jog-axes", "at TABLE"), "its axes can be chosen")
    began, kinematics = arm.snapshot().q_setpoint, Arm(load_robot("puma560"))
    way = lambda: (kinematics.forward(arm.snapshot().q_setpoint) - kinematics.forward(began))[:3, 3]  # noqa: E731
    press_until(page, arm, lambda: bool(np.linalg.norm(way()) > FAR_M), lambda page: page.press(PLUS_OF_X))
    page.let_go()
    wait_until(lambda: is_at_rest(arm), "at rest")
    assert way()[1] > 0.95 * np.linalg.norm(way())  # at the end the servo itself may have braked it, joint by joint
    page.choose_option("jog-axes", "base")


def tells_who_drives(watcher: Page, page: Page) -> bool:
    """A page shows that the other one drives, which may have been too busy to say so, and has lost its lease."""
    if not page.run("return pendant.driving"):
        drive(page)
    return watcher.shows("#drive", "Ask page")


def each_arm_has_a_lease_that_is_taken_and_given_up(page: Page, other: Page) -> None:
    """Two pages, and a second arm that is not there; at the end nobody drives the first one."""
    first, second = (each.run("return pendant.page") for each in (page, other))
    assert page.run("return pendant.view.figures.length") == 2
    choose_arm(other, 1)
    other.click("drive")
    wait_until(lambda: drivers(page) == drivers(other) == [first, second], "each drives an arm")
    wait_until(lambda: page.shows('[data-arm="1"]', f"page {second} drives"), "it is shown")
    choose_arm(other, 0)
    for each in (page, other):
        each.run(NOTE_NOTICES)  # any later one takes its place
    other.click("drive")  # asks
    wait_until(lambda: page.run(WAS_NOTICED, f"page {second} asks to drive"), "the page that drives is told")
    assert drivers(other) == [first, second]
    page.click("keep")
    wait_until(lambda: other.run(WAS_NOTICED, f"page {first} keeps driving"), "it does not get it")
    other.click("drive")
    wait_until(lambda: page.shows("#drive", f"Give up to page {second}"), "the page that drives is asked")
    page.click("drive")
    wait_until(lambda: drivers(page) == drivers(other) == [second, second], "the other page drives both")
    assert page.run("return pendant.hold('joint', '1', {})") is False
    other.click("drive")
    wait_until(lambda: drivers(page) == [None, second], "the first arm is free")


def the_arm_is_braked_when_the_network_is_cut_and_moves_with_another_press_alone(
    page: Page, watcher: Page, arm: RunningArm, relay: Relay
) -> None:
    """Told by the process that moves the arm. Where it stalls itself the servo stops the arm first: then once more."""
    silence = None
    while silence is None:
        take(page)
        press_until_it_moves(page, arm)
        relay.cut = True  # both ends stay open: nobody is told
        wait_until(lambda: is_at_rest(arm), "at rest since the network was cut")
        silence = re.search(
            r"heard of the page that drives for ([\d.]+) s", watcher.run("return pendant.armStatus.notice")
        )
        assert is_at_rest(arm)  # with the button still down
        relay.mend()
        wait_until(lambda: page.run("return pendant.open && pendant.armStatus !== null"), "the page is back")
        assert is_at_rest(arm)
        page.let_go()
    assert PRESS_PATIENCE_S <= float(silence[1]) <= PRESS_PATIENCE_S + PATIENCE_NS * 1e-9  # told to a millisecond
    take(page)


def the_arm_is_led_by_hand_while_its_button_is_held(page: Page, arm: RunningArm) -> None:
    """A push at the emulated arm is the hand; at the end `page` drives, and has let go of the arm."""
    take_to_lead(page)
    assert page.run("return pendant.hold('joint', '1', {})") is False
    began = arm.snapshot().q[ELBOW]
    with attach_board_memory(arm.name) as board:
        board.memory.panel.push[ELBOW] = round(LEADING_N_M * PANEL_MICRO)
        while arm.snapshot().q[ELBOW] < began + LED_RAD:  # a page that stalls leads it no longer: press anew
            take_to_lead(page)
            page.press("guide-hold")
            give_time(LED_S)
            page.let_go()
        wait_until(lambda: is_at_rest(arm), "it is held although the hand pushes on")
        board.memory.panel.push[ELBOW] = 0
    take_to_lead(page)
    page.click("guide-place")
    wait_until(lambda: page.run("return 'P1' in pendant.armStatus.taught"), "the place is kept")
    let_go_of_the_led_arm(page)
    page.click("guide-write")
    wait_until(lambda: "qrobot replay" in page.run("return pendant.armStatus.notice"), "the recording is written")


def a_program_is_paused_while_no_page_drives_led_back_to_its_path_and_ended_by_stop(
    arm: RunningArm, page: Page
) -> None:
    """Begins with a page that drives, and has let go of the arm; so it ends."""
    page.click("tab-programs")
    page.click_at(f'[data-name="{ONCE}"]')
    unless_stalled(lambda: go_to_the_end(page))
    wait_until(lambda: points_ahead(page) == 0, "nothing is ahead")

    page.click_at(f'[data-name="{PROGRAM}"]')
    wait_until(lambda: page.shows("#source", "while True"), "its source")
    page.click("start-live")
    assert state_of_program(page) != "running"  # it waits for a confirmation
    choose_arm(page, 1)
    assert page.run("return document.getElementById('start-sure').offsetParent === null")  # which was about the other
    choose_arm(page, 0)
    page.click_at(f'[data-name="{PROGRAM}"]')
    page.click("start-live")
    page.click("start-sure")
    wait_until(lambda: arm.mode is Mode.TRACKING, "the program moves the arm")
    page.click("drive")  # gives up
    wait_until(lambda: page.flag(RobotFlag.PAUSED), "motions are paused")
    wait_until(lambda: is_at_rest(arm), "it stands on its path")
    assert state_of_program(page) == "running"
    page.click("drive")
    let_it_go_on(page, arm)
    with ServoClient(arm.name) as servo:
        servo.stop()
    wait_until(lambda: page.shows("#fault", "waits beside its path"), "what to do is told")
    assert page.flag(RobotFlag.PATH_WAITS)
    assert is_at_rest(arm)
    wait_until(lambda: page.shows("#program-pause", "Go back to the path"), "it can be led back")
    let_it_go_on(page, arm)
    page.type(Keys.ESCAPE)
    arm.wait_for(Mode.HOLDING)
    wait_until(lambda: state_of_program(page) == "ended", "the program has ended")
    page.click("tab-drive")


def points_ahead(page: Page) -> float:
    """Points of the path that is drawn ahead of the first arm."""
    return float(page.run("return pendant.view.figures[0].ahead.points"))  # type: ignore[arg-type]


def the_path_ahead_of_one_that_returns_is_not_cut_short(page: Page) -> None:
    """There by a radian and back: the same places lie ahead once more until the turn, also when some were not seen."""
    assert page.run(THERE_AND_BACK, [0.2, 0.5, 1.0, 0.8, 0.3]) == [181, 151, 101, 81, 31]


def go_to_the_end(page: Page) -> None:
    """Run the chosen program off line, and live along the path that was found.

    Raises StreamLostError: as a machine that stalls may bring about; a program that keeps no path has ended then.
    """
    page.click("start-offline")
    wait_until(lambda: state_of_program(page) == "done" and points_ahead(page) > 0, lambda: how_it_ran(page))
    ahead = points_ahead(page)
    page.click("start-live")
    page.click("start-sure")
    come_to(page, lambda: 0 < points_ahead(page) < ahead / 2, "the arm has come over half of it")
    come_to(page, lambda: state_of_program(page) == "done", "the program is done")


def come_to(page: Page, place: Callable[[], bool], what: str) -> None:
    """Wait until the program comes there. Raises StreamLostError. A page that has lost its lease drives again."""

    def there_or_failed() -> bool:
        if not page.run("return pendant.driving"):
            page.click_if("#drive")
        page.click_if("#program-pause[data-on]")
        return place() or state_of_program(page) == "failed"

    wait_until(there_or_failed, lambda: f"{what}: {how_it_ran(page)}")
    if state_of_program(page) == "failed":
        wait_until(lambda: "STREAM_LOST" in output_of(page), lambda: how_it_ran(page))
        raise StreamLostError(how_it_ran(page))


def output_of(page: Page) -> str:
    """What the program that was started last has printed, as far as the page has asked for it."""
    return str(page.run("return document.getElementById('output').textContent"))


def how_it_ran(page: Page) -> str:
    """State of the program, of its path and of the arm, for a test that fails."""
    told = page.run("return JSON.stringify([pendant.driving, pendant.armStatus])")
    return f"{state_of_program(page)}, {points_ahead(page):g} points ahead, {told}: {output_of(page)}"


def let_it_go_on(page: Page, arm: RunningArm) -> None:
    """Confirm, and once more when the servo has stopped the arm again: a machine that stalls loses its stream."""

    def moves() -> bool:
        page.click_if("#program-pause[data-on]")  # a click on what it is without that would pause the motions again
        assert state_of_program(page) == "running", output_of(page)
        return not is_at_rest(arm)

    wait_until(moves, "the program goes on")
    assert not page.flag(RobotFlag.PATH_WAITS)


def every_tab_opens(page: Page) -> None:
    shown = {
        "programs": (".program", PROGRAM),
        "board": ("#board-facts", "revision"),
        "calibrate": ("#procedure-state", "nothing"),
    }
    for tab in ("scope", "teach", "programs", "board", "calibrate", "drive"):
        page.click(f"tab-{tab}")
        place, text = shown.get(tab, (f".pane-{tab}", ""))
        wait_until(lambda place=place, text=text: page.shows(place, text), f"{tab} shows {text}")
    assert page.complaints() == []
    asked = page.run("return performance.getEntriesByType('resource').map((entry) => new URL(entry.name).host)")
    assert set(asked) == {page.run("return location.host")}


def the_scope_waits_for_a_motion(page: Page) -> None:
    page.click("tab-scope")
    wait_until(lambda: page.choose_option("scope-source", "ring"), "every cycle can be chosen")
    wait_until(lambda: page.shows("#scope-about", "cycles"), "every cycle is shown")
    wait_until(lambda: page.choose_option("trigger", "velocity"), "the trigger can be chosen")
    page.run("document.getElementById('trigger-level').value = '1'")
    page.click("trigger-arm")
    page.click("tab-drive")


def every_cycle_of_the_motion_is_kept(page: Page) -> None:
    page.click("tab-scope")
    wait_until(lambda: page.shows("#trigger-told", "triggered"), "the trigger has seen the motion")
    wait_until(lambda: page.shows("#freeze", "Go on"), "it is frozen")
    assert not page.shows("#scope-problem", "")
    page.click("tab-drive")


def a_trigger_is_for_what_comes_and_not_for_what_was(page: Page) -> None:
    """Armed at a frozen picture, since which the arm has moved and rests."""
    page.click("tab-scope")
    assert page.shows("#freeze", "Go on")
    page.run(COUNT_LOOKS)
    page.click("trigger-arm")
    wait_until(lambda: page.shows("#trigger-told", "waits"), "it waits")
    wait_until(lambda: page.run("return looks >= 4"), "the scope has looked for what comes, twice at least")
    assert page.shows("#trigger-told", "waits")
    page.click("trigger-arm")
    page.click("tab-drive")


def a_log_is_opened_while_it_is_written(page: Page) -> None:
    page.click("tab-logs")
    page.click_at(".pane-logs .entry[data-name]")
    wait_until(lambda: page.shows("#log-about", "1000 Hz"), "the log is open")
    assert page.run("return document.querySelectorAll('.pane-logs .uplot').length") == 2  # error and position
    assert not page.shows("#log-problem", "")
    page.click("tab-drive")


def the_arm_is_seen_where_its_kinematics_says(page: Page) -> None:
    """The marker of the tool is in the picture where forward kinematics and camera put it, once all is laid out."""

    def seen() -> bool:
        page.run("pendant.view.draw()")
        x, y = page.run("return pendant.tipOnScreen()")
        picture = np.asarray(Image.open(io.BytesIO(page.picture(".scene canvas"))).convert("RGB")).astype(int)
        off = np.abs(picture - TOOL_COLOUR).max(axis=2)
        rows, columns = np.nonzero(off < 12)
        height, width = off.shape
        return rows.size > 2 and bool(np.hypot(columns.mean() - x * width, rows.mean() - y * height) < AROUND_PX)

    wait_until(seen, "the marker is where the tool is")


def a_picture_that_takes_long_is_drawn_less_often(page: Page) -> None:
    """Where drawing takes 100 ms, as long a time and longer is left to what else the page has to do."""
    page.run(SLOW_PICTURE)
    wait_until(lambda: page.run("return pendant.drawn.length > 6"), "some pictures")
    assert np.diff(page.run("pendant.quick(); return pendant.drawn")).min() >= 250.0


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
    wait_until(lambda: page.shows(".scene .nearest", "mm off"), "the picture says how far off the nearest is")


@needs_browser
def test_what_is_held_ends_with_the_key_or_button_whatever_that_is_called_meanwhile_and_with_any_other(
    arm: RunningArm, pendant: Pendant
) -> None:
    arm.wait_for_rest()
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        drive(page)
        began = arm.snapshot().q[0]
        moved = lambda: bool(arm.snapshot().q[0] > began + FAR_RAD)  # noqa: E731
        press_until(page, arm, moved, lambda page: page.key("Down", "."), lambda page: page.key("Up", "."))
        page.key("Up", ">", modifiers=SHIFT)  # Shift went down meanwhile
        assert not page.run(IS_HELD)
        wait_until(lambda: is_at_rest(arm), "at rest")

        for key, focused in ((".", "body"), (",", "body"), ("Enter", ".hold")):
            for ends in ENDS_OF_A_HELD_KEY:
                hold_key(page, key, focused)
                ends(page)
                assert not page.run(IS_HELD), (key, ends)
                page.key("Down", key, repeat=True)  # still down
                assert not page.run(IS_HELD), (key, ends)
                page.key("Up", key)
            for modifier in (ALT, CTRL, META):
                page.key("Down", key, modifier)
                assert not page.run(IS_HELD), (key, modifier)
                page.key("Up", key, modifier)

        hold(page, lambda: page.press(PLUS_OF_JOINT_1), page.let_go)
        page.let_go_with_the_right_button_down()
        assert not page.run(IS_HELD)
        page.let_go_of_the_right_button()


def hold_key(page: Page, key: str, focused: str) -> None:
    """Hold a key down, with an element in the focus, until it repeats."""

    def press() -> None:
        page.run("document.activeElement.blur(); document.querySelector(arguments[0]).focus()", focused)
        page.key("Down", key)
        page.key("Down", key, repeat=True)

    hold(page, press, lambda: page.key("Up", key))


def hold(page: Page, press: Callable[[], None], let_go: Callable[[], None]) -> None:
    """Press until it counts: where the session has lost its stream since the arm was taken, it does not."""

    def held() -> bool:
        take(page)
        press()
        if page.run(IS_HELD):
            return True
        let_go()
        return False

    wait_until(held, "the press counts")


@pytest.mark.thorough
@needs_browser
def test_the_speed_override_is_what_the_slider_shows_however_long_a_finger_rests_on_it(pendant: Pendant) -> None:
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        page.click("drive")
        wait_until(lambda: page.run("return !document.getElementById('override').disabled"), "it can be moved")
        page.touch("#override")
        give_time(RESTS_S)
        assert page.run("return document.getElementById('override').value") == "50"
        page.let_go()
        wait_until(lambda: page.run("return pendant.arm.state.override") == 0.5, "it is in force")
        page.run("pendant.order({do: 'override', arm: 0, factor: 1})")
        wait_until(lambda: page.run("return pendant.arm.state.override") == 1.0, "as before")


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
