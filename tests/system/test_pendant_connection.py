"""A page of the pendant: STOP, and what is being chosen and typed, also when the connection is lost for a while."""

from __future__ import annotations

import pytest
from selenium.webdriver.common.keys import Keys

from tests.support.browser import Page, needs_browser, open_browser
from tests.support.patience import wait_until
from tests.support.pendant_process import Pendant
from tests.support.relay import Relay
from tests.system.test_pendant import choose_arm

pytestmark = [pytest.mark.realtime, needs_browser]

NUMBERS = [400.0, 0.0, 0.0, 90.0, 0.0, 0.0]
CELL = ".place-editor input[type=number]"
TAKEN = """
pendant.view.draw();
const { geometries, textures } = pendant.view.renderer.info.memory;
return [geometries, textures];
"""
LOST = "STOP HAS NOT REACHED THE PENDANT"


def take_the_lease(page: Page) -> None:
    page.click("drive")
    wait_until(lambda: page.run("return pendant.driving"), "this page drives")


def record(page: Page, name: str) -> None:
    page.run("pendant.say({do: 'place', arm: 0, name: arguments[0], numbers: arguments[1]})", name, NUMBERS)
    wait_until(lambda: page.run("return arguments[0] in (pendant.armStatus?.taught ?? {})", name), "it is recorded")


def lose_the_connection(page: Page) -> None:
    page.run("window.lost = pendant.socket; lost.close()")
    back = "return pendant.socket !== lost && pendant.open && pendant.armStatus !== null"
    wait_until(lambda: page.run(back), "the page is back, by another connection")


@pytest.mark.thorough
def test_an_editor_of_a_place_and_the_axes_stay_through_a_loss_and_go_with_the_arm(pendant: Pendant) -> None:
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        take_the_lease(page)
        record(page, "FIXTURE")
        assert page.choose_option("jog-axes", "at FIXTURE")
        page.click("tab-teach")
        page.click_at('[aria-label="edit FIXTURE"]')
        page.run(f"const cell = document.querySelector('{CELL}'); cell.value = '123'; cell.focus()")
        lose_the_connection(page)
        take_the_lease(page)
        record(page, "ANOTHER")
        assert page.run(f"return document.querySelector('{CELL}') === document.activeElement")
        assert page.run("return document.activeElement.value") == "123"
        assert page.run("return document.getElementById('jog-axes').value") == "at FIXTURE"
        choose_arm(page, 1)
        assert page.run(f"return document.querySelector('{CELL}') === null")
        for name in ("FIXTURE", "ANOTHER"):
            page.run("pendant.say({do: 'remove', arm: 0, name: arguments[0]})", name)


def test_a_stop_that_does_not_reach_the_pendant_is_told_and_said_again(pendant: Pendant) -> None:
    host, port = pendant.host.split(":")
    with Relay((host, int(port))) as relay, open_browser() as driver:
        page = Page(driver, pendant.address_by(relay))
        page.draw_no_more()
        page.type(Keys.ESCAPE)
        wait_until(lambda: page.run("return pendant.status.stops === 1 && pendant.unread === null"), "it was read")
        assert not page.shows("#fault", LOST)
        relay.cut = True  # both ends stay open: nobody is told
        page.type(Keys.ESCAPE)
        wait_until(lambda: page.shows("#fault", LOST), "it is told")
        wait_until(lambda: page.shows("#fault", "The pendant does not answer"), "silence is no connection")
        assert page.shows("#driver", "no pendant")
        page.type(Keys.ESCAPE)
        relay.mend()
        wait_until(lambda: page.run("return pendant.status?.stops === 1"), "it is said again")
        wait_until(lambda: not page.shows("#fault", LOST), "it was read")


def test_the_space_bar_stops_wherever_no_text_is_being_typed(pendant: Pendant) -> None:
    """An emptied field may have kept the focus of what was sent, and a number has no blank."""
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        for kind, text, stops in (("text", "", 1), ("number", "12", 2), ("text", "part", 2)):
            page.run(
                "const field = document.createElement('input'); field.type = arguments[0]; field.value = arguments[1];"
                "field.id = 'probe' + arguments[2]; document.body.append(field); field.focus();",
                kind, text, stops,
            )  # fmt: skip
            driver.switch_to.active_element.send_keys(Keys.SPACE)
            if text == "part":
                assert page.run("return document.activeElement.value") == "part "
            wait_until(lambda stops=stops: page.run("return pendant.status?.stops") == stops, "it was counted")


@pytest.mark.thorough
def test_that_a_stop_has_not_reached_an_arm_is_told_beside_what_is_told_of_another_one(pendant: Pendant) -> None:
    """The second arm is not there."""
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        page.type(Keys.ESCAPE)
        lost = lambda: page.shows("#fault", "absent: STOP HAS NOT REACHED THE ARM")  # noqa: E731
        wait_until(lost, "it is told")
        # The page shows the newest line of both arms. Of this one it is the servo's, the bridge's where that answers
        # late, or of what jogs the arm.
        told = (
            "STOP was pressed: the servo is",
            "STOP was sent by the bridge",
            "STOP was pressed: the pendant does not",
        )
        newest = lambda: page.run("return pendant.status.arms[0].notice")  # noqa: E731
        wait_until(lambda: newest().startswith(told), "the other one was told")
        assert lost()
        # Of the one that is there it may be unsure too, in a line above, where its servo answers late.
        wait_until(lambda: page.click_if("#fault .dismiss") and not lost(), "it is taken away")
        page.type(Keys.ESCAPE)
        wait_until(lost, "it is told anew")


@pytest.mark.thorough
def test_what_every_page_may_ask_for_can_be_pressed_while_nothing_is_heard_of_the_arm(pendant: Pendant) -> None:
    """The second one is not there, nobody drives it, and it is not known to have power."""
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        choose_arm(page, 1)
        wait_until(lambda: page.shows("#fault", "No arm"), "nothing is heard of it")
        for each in ("stop", "power-off", "pause"):
            assert not page.run("return document.getElementById(arguments[0]).disabled", each)
        page.click("power-off")
        choose_arm(page, 0)
        wait_until(lambda: page.shows("#fault", "absent: Power off HAS NOT REACHED THE ARM"), "it was asked for")


@pytest.mark.thorough
def test_a_page_whose_connection_is_lost_again_and_again_draws_the_arms_with_what_it_took_first(
    pendant: Pendant,
) -> None:
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        taken = page.run(TAKEN)
        assert min(taken) > 0
        for _ in range(3):
            lose_the_connection(page)
            wait_until(lambda: page.run("return pendant.arm.state !== null"), "the arm is shown again")
        assert page.run(TAKEN) == taken


@pytest.mark.thorough
def test_a_place_is_recorded_over_another_of_its_name_only_when_that_is_asked_twice(pendant: Pendant) -> None:
    with open_browser() as driver:
        page = Page(driver, pendant.address)
        page.draw_no_more()
        take_the_lease(page)
        record(page, "FIXTURE")
        page.click("tab-teach")
        page.run(
            "window.recorded = []; const say = pendant.say.bind(pendant);"
            "pendant.say = (message) => (message.do === 'record' ? recorded.push(message.name) : say(message))"
        )
        field = "const field = document.getElementById('place-name'); field.value = arguments[0];"
        for name, asked, recorded in (("FIXTURE", True, []), ("NEW", False, ["NEW"]), ("FIXTURE", True, ["NEW"])):
            page.run(f"{field} field.dispatchEvent(new Event('input'))", name)
            assert page.shows("#record", "Record where the arm is")
            page.click("record")
            assert page.shows("#record", "Really record over FIXTURE") == asked
            assert page.run("return recorded") == recorded

        def recorded_at_last() -> bool:  # not by the second click of a double one
            page.click("record")
            return bool(page.run("return recorded.length > 1"))

        wait_until(recorded_at_last, "it is recorded over")
        assert page.run("return recorded") == ["NEW", "FIXTURE"]
        assert page.shows("#record", "Record where the arm is")
        page.run("pendant.say({do: 'remove', arm: 0, name: arguments[0]})", "FIXTURE")
