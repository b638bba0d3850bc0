"""The pictures of the how-to on driving from a browser, and the films of the tour, chapter by chapter.

Made by `python docs/pendant_pictures.py`: an emulated arm, `qrobot pendant`, and Debian's chromium without a screen.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

from pendant_film import IMAGES, Film, keep  # noqa: E402 (found through the line above)

from qrobot.servo.operator.client import ServoClient  # noqa: E402
from qrobot.wire.vocabulary import RobotFlag  # noqa: E402
from tests.support.browser import Page, open_browser  # noqa: E402
from tests.support.patience import give_time, wait_until  # noqa: E402
from tests.support.processes import RunningArm, qrobot, running_arms  # noqa: E402

LOOK_S: Final = 2.0
PLUS_OF_JOINT_1, PLUS_OF_X, MINUS_OF_Z = 1, 13, 16  # of the buttons to hold: two a joint, then two an axis
TABLE: Final = [450.0, -250.0, -250.0, 30.0, 0.0, 20.0]
HOLD_GO: Final = "return pendant.hold('place', 'park', {share: 1})"
PROGRAM: Final = "swing.py"
SOURCE: Final = '''"""Back and forth, on a path that outlives a stop."""

from qrobot import rccl

with rccl.control("puma560") as arm:
    arm.keep_path()
    waist, *others = arm.joints
    for degrees in (-60.0, 30.0, 0.0):
        arm.move(arm.jposition("swing", [waist + degrees, *others]))
    arm.waitfor(arm.completed)
'''


@contextmanager
def opened_pendant(arm: RunningArm, folder: Path) -> Iterator[str]:
    """Address of a pendant."""
    programs = folder / "programs"
    programs.mkdir()
    (programs / PROGRAM).write_text(SOURCE)
    options = ("--port", "0", "--taught", folder / "parts.db", "--programs", programs)
    process = qrobot("pendant", "--deployment", arm.deployment, *options)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate()


def main() -> None:
    """Drive an emulated arm through the tour."""
    lasted = 0.0
    with (
        TemporaryDirectory() as folder,
        running_arms(Path(folder), period_ms=28.0, name="puma") as (arm,),
        opened_pendant(arm, Path(folder)) as address,
        open_browser() as driver,
    ):
        page = Page(driver, address)
        for name, chapter in CHAPTERS.items():
            film = Film(page)
            chapter(page, film)
            film.write(IMAGES / f"tour_{name}.gif")
            lasted += film.seconds
            print(f"{name}: {film.seconds:.0f} s")
    print(f"the tour lasts {lasted:.0f} s")


def take_it(page: Page) -> None:
    """Take the arm to jog it."""
    if page.run("return pendant.armStatus.session === 'no'"):
        page.click("tab-drive")
        page.click("take")
    wait_until(lambda: page.run("return pendant.ready"), "the arm follows")


def give_it(page: Page) -> None:
    """Let go of it, unless it was let go of already."""
    if page.run("return pendant.armStatus.session !== 'no'"):
        page.click("take")
    wait_until(lambda: page.run("return pendant.armStatus.session === 'no'"), "let go")


# ------------------------------------------------------------------------------------------------------- the chapters


def jog(page: Page, film: Film) -> None:
    """Take the arm and move it by buttons."""
    film.take("The page shows the arm live; everybody with the address may look")
    page.run("pendant.view.camera.position.x += 1.2; pendant.view.controls.update()")
    film.take("Turn the picture with the pointer; the bars show each joint between its limits")
    page.click("drive")
    page.click("power-on")
    wait_until(lambda: page.shows("#mode", "HOLDING"), "power")
    film.take("Drive from here, and Power on: one page drives at a time")
    take_it(page)
    film.take("Take the arm: the pendant commands it now, and no program can")
    page.press(PLUS_OF_JOINT_1)
    film.take("Hold + or −: the joint turns for as long as you hold it")
    film.follow(4)
    page.let_go()
    film.take("Let go, and it is braked; also when the page stalls or its network is cut")
    page.run(f"pendant.say({{do: 'place', arm: 0, name: 'TABLE', numbers: {TABLE}}})")
    wait_until(lambda: page.choose_option("jog-axes", "at TABLE"), "its axes")
    page.press(PLUS_OF_X)
    give_time(LOOK_S)
    film.take("Straight along the axes of base, tool, or a taught place drawn in the picture")
    keep(page, "pendant")
    film.follow(3)
    page.let_go()
    page.choose_option("jog-axes", "base")
    page.choose_option("jog-step", "10")
    for _ in range(2):
        page.press(MINUS_OF_Z)
        give_time(1.0)
        page.let_go()
    film.take("By steps: each press moves the tool by 10 mm")
    page.choose_option("jog-step", "0")


def teach(page: Page, film: Film) -> None:
    """Record a place, edit it, go to another one."""
    page.click("tab-teach")
    film.take("Teach: the robot's own poses, and the places that were recorded")
    page.run("document.getElementById('place-name').value = 'OVER'")
    film.take("Move the arm, type a name, and Record where the arm is")
    page.click("record")
    wait_until(lambda: page.run("return 'OVER' in pendant.armStatus.taught"), "it is recorded")
    film.take("Programs read it by its name: DataBase(path).get('OVER')")
    page.click_at(".edit")
    film.take("Edit a place by its numbers, mm and degrees in the base; rename or delete it")
    keep(page, "pendant_teach")
    page.click_at(".place-editor button[type=button]")
    take_it(page)  # anew, should a busy machine have lost it
    page.click("tab-teach")
    wait_until(lambda: page.run(HOLD_GO), "Go is held")
    film.take("Hold Go: all joints move together, slowly; let go, and it stops")
    page.click("tab-drive")
    film.follow(3)
    page.run("pendant.release()")
    film.take("It stands on the way to park")


def programs(page: Page, film: Film) -> None:
    """Off line, then live, slowed down, stopped and led back."""
    page.click("tab-drive")
    give_it(page)
    page.click("tab-programs")
    page.click_at(f'[data-name="{PROGRAM}"]')
    film.take("Programs: Python, C and VAL II of a folder, and recordings of the arm")
    page.click("start-offline")
    wait_until(lambda: page.shows("#program-state", "done"), "off line")
    give_time(LOOK_S)
    film.take("Off line first: only a ghost moves, from where the arm stands")
    film.follow(3)
    keep(page, "pendant_programs")
    page.click("tab-drive")
    film.take("Its path is dotted in the picture: nothing has moved yet")
    page.click("tab-programs")
    page.click("start-live")
    film.take("Live: the page that drives has to confirm")
    page.click("start-sure")
    wait_until(lambda: page.shows("#mode", "TRACKING"), "live")
    page.click("tab-drive")
    give_time(LOOK_S)
    film.take("The program moves the arm; the dots that are left lie ahead")
    film.follow(2)
    page.run("pendant.say({do: 'override', arm: 0, factor: 0.5})")
    film.take("Speed override: half as fast on the same path, and a pause on it")
    with ServoClient(page.run("return pendant.arm.facts.name")) as servo:
        servo.stop()
    wait_until(lambda: page.flag(RobotFlag.PATH_WAITS), "it waits")
    film.take("Stopped: the program waits beside its path until somebody confirms")
    keep(page, "pendant_waits")
    page.run("pendant.say({do: 'override', arm: 0, factor: 1})")
    page.click("pause")
    wait_until(lambda: not page.flag(RobotFlag.PATH_WAITS), "it goes back")
    film.take("Go back to the path: slowly, and then on along the same places")
    film.follow(4)
    wait_until(lambda: page.run("return pendant.armStatus.program.state === 'done'"), "the program is done")


def scope(page: Page, film: Film) -> None:
    """Curves of a running arm, and its log."""
    take_it(page)
    page.press(PLUS_OF_JOINT_1)
    give_time(LOOK_S)
    page.let_go()
    page.click("tab-scope")
    film.take("Scope: tracking error, velocity, torque, position of every joint, live")
    keep(page, "pendant_scope")
    page.choose_option("scope-source", "ring")
    wait_until(lambda: page.shows("#scope-about", "cycles"), "every cycle is shown")
    film.take("Or every cycle of the servo, a thousand a second, out of its own memory")
    page.choose_option("trigger", "velocity")
    page.run("document.getElementById('trigger-level').value = '1'")
    page.click("trigger-arm")
    film.take("A trigger waits for what you look for: here for a degree a second")
    page.click("tab-drive")
    page.press(PLUS_OF_JOINT_1)
    give_time(LOOK_S)
    page.let_go()
    page.click("tab-scope")
    wait_until(lambda: page.shows("#freeze", "Go on"), "it is frozen")
    film.take("It has seen the motion, and keeps the cycles around its beginning")
    page.click("tab-logs")
    page.click_at(".pane-logs .entry[data-name]")
    wait_until(lambda: page.shows("#log-about", "1000 Hz"), "the log is open")
    give_time(LOOK_S)
    film.take("Logs: every cycle since the servo began; scrub through them, compare two")
    page.click("log-play")
    film.follow(4)
    page.click("log-play")


def load(page: Page, film: Film) -> None:
    """What the hand carries, what follows a collision, and the arm in a person's hand."""
    page.click("tab-drive")
    film.take("Load and collisions: what the servo reckons with", at=".card.load")
    page.run("document.getElementById('load-mass').value = '2'; document.getElementById('load-z').value = '60'")
    page.click("load-set")
    wait_until(lambda: page.shows("#load-told", "carries 2.00 kg"), "the servo reckons with it")
    film.take("Set the load: 2 kg in the hand, carried from now on; too much is refused", at=".card.load")
    page.choose_option("collision-share", "0.5")
    page.choose_option("collision-reaction", "comply")
    page.click("collision-set")
    give_time(LOOK_S)
    film.take("A collision is told at half the force, and the arm is soft after it", at=".card.load")
    page.run("pendant.say({do: 'load', arm: 0, mass: 0, centre_mm: [0, 0, 0]})")
    give_it(page)
    page.click("guide-take")
    wait_until(lambda: page.run("return pendant.leading"), "it is taken to lead")
    film.take("Take it to lead: while the button is held the arm follows your hand", at="#guide-hold")
    page.click("guide-take")
    wait_until(lambda: page.run("return pendant.armStatus.session === 'no'"), "let go")


def faults(page: Page, film: Film) -> None:
    """The board, and a fault with its remedy."""
    page.click("tab-board")
    wait_until(lambda: page.shows("#board-facts", "revision"), "the board")
    give_time(LOOK_S)
    film.take("Board: every register and status bit as it is, five times a second")
    keep(page, "pendant_board")
    film.take("The emulated one has a panel besides, and lets things break", at="#board-work")
    page.click("force-estop")
    wait_until(lambda: page.shows("#fault", "mergency stop"), "the servo has seen it")
    page.click("tab-drive")
    film.take("The emergency stop was pressed: power has gone, and the page tells what to do")
    page.run("pendant.say({do: 'board force', arm: 0, line: 'estop off'})")
    wait_until(lambda: page.flag(RobotFlag.ESTOP_OK), "it is released")
    page.click("clear")
    wait_until(lambda: page.shows("#mode", "OFF"), "the fault is cleared")
    page.click("power-on")
    wait_until(lambda: page.shows("#mode", "HOLDING"), "it holds")
    film.take("Released, cleared, and powered again: it holds where it is")
    page.click("tab-calibrate")
    film.take("Calibrate and identify, a step at a time, with progress and results")


CHAPTERS: Final[dict[str, Callable[[Page, Film], None]]] = {
    "jog": jog,
    "teach": teach,
    "programs": programs,
    "scope": scope,
    "load": load,
    "faults": faults,
}

if __name__ == "__main__":
    main()
