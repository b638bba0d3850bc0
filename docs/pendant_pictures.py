"""The pictures of the how-to on driving from a browser, and the film of the tour.

Made by `python docs/pendant_pictures.py`: an emulated arm, `qrobot pendant`, and Debian's chromium without a screen.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import matplotlib as mpl
from PIL import Image, ImageDraw, ImageFont

sys.path.insert(0, str(Path(__file__).parents[1]))

from qrobot.servo.operator.client import ServoClient
from qrobot.wire.vocabulary import RobotFlag
from tests.support.browser import Page, open_browser
from tests.support.patience import give_time, wait_until
from tests.support.processes import RunningArm, qrobot, running_arms

IMAGES: Final = Path(__file__).parent / "images"
COLOURS: Final = 96  # of a picture: pages are plain
FONT: Final = Path(mpl.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"
FILM_WIDTH, CAPTION, LETTERS, FILM_COLOURS = 760, 34, 17, 160  # pixels, and colours
READ_MS, NEXT_MS = 3500, 700  # of a picture with a new caption, of the next one
SETTLED_S, LOOK_S = 0.4, 2.0
PLUS_OF_JOINT_1, PLUS_OF_X = 1, 13  # of the buttons to hold: two a joint, then two an axis
TABLE: Final = [450.0, -250.0, -250.0, 30.0, 0.0, 20.0]
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


class Film:
    """Pictures of a page with a line of text below each."""

    def __init__(self, page: Page) -> None:
        self._page, self._caption = page, ""
        self._pictures: list[Image.Image] = []
        self._lengths: list[int] = []

    def take(self, caption: str = "") -> None:
        """What the window shows now; without a caption that of before stays."""
        self._lengths.append(READ_MS if caption else NEXT_MS)
        self._caption = caption or self._caption
        page = whole(self._page)
        shown = page.resize((FILM_WIDTH, page.height * FILM_WIDTH // page.width), Image.Resampling.LANCZOS)
        picture = Image.new("RGB", (FILM_WIDTH, shown.height + CAPTION), "#17212c")
        picture.paste(shown)
        font = ImageFont.truetype(str(FONT), LETTERS)
        ImageDraw.Draw(picture).text((10, shown.height + 6), self._caption, "white", font)
        self._pictures.append(picture)

    def write(self, path: Path) -> None:
        """Write it as GIF, with the colours of its first picture and of the last."""
        both = Image.new("RGB", (FILM_WIDTH, 2 * self._pictures[0].height))
        both.paste(self._pictures[0])
        both.paste(self._pictures[-1], (0, self._pictures[0].height))
        palette = both.quantize(FILM_COLOURS, dither=Image.Dither.NONE)
        first, *others = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in self._pictures)
        first.save(path, save_all=True, append_images=others, duration=self._lengths, loop=0, optimize=True)


def whole(page: Page) -> Image.Image:
    """What a window shows, from its top, without the newest line for people."""
    page.run("document.querySelector('.dismiss').click(); window.scrollTo(0, 0)")
    give_time(SETTLED_S)
    return Image.open(BytesIO(page.window_picture())).convert("RGB")


def keep(page: Page, name: str) -> None:
    """Write what a window shows into the folder of pictures."""
    picture = whole(page).quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(IMAGES / f"{name}.png", optimize=True)


@contextmanager
def opened_pendant(arm: RunningArm, folder: Path) -> Iterator[str]:
    """Address of a pendant."""
    programs = folder / "programs"
    programs.mkdir()
    (programs / PROGRAM).write_text(SOURCE)
    options = ("--port", "0", "--taught", folder / "parts.db", "--programs", programs)
    process = qrobot("pendant", "--deployment", arm.deployment, *options)
    assert process.stdout is not None
    yield process.stdout.readline().strip()
    process.send_signal(signal.SIGINT)
    process.communicate()


def main() -> None:
    """Drive an emulated arm through the tour."""
    with (
        TemporaryDirectory() as folder,
        running_arms(Path(folder), period_ms=28.0, name="puma") as (arm,),
        opened_pendant(arm, Path(folder)) as address,
        open_browser() as driver,
    ):
        page = Page(driver, address)
        film = Film(page)
        film.take("The page shows the arm live; everybody with the address may look")
        jog(page, film)
        look(page, film)
        run_program(page, film, arm)
        film.write(IMAGES / "tour.gif")


def jog(page: Page, film: Film) -> None:
    """Take the arm and move it by buttons."""
    page.click("drive")
    page.click("power-on")
    wait_until(lambda: page.shows("#mode", "HOLDING"), "power")
    film.take("Drive from here, and Power on: one page drives at a time")
    page.click("take")
    wait_until(lambda: page.run("return pendant.ready"), "the arm follows")
    page.press(PLUS_OF_JOINT_1)
    film.take("Take the arm, and hold + or −: it moves while you hold")
    for _ in range(3):
        film.take()
    page.let_go()
    page.run(f"pendant.say({{do: 'place', arm: 0, name: 'TABLE', numbers: {TABLE}}})")
    wait_until(lambda: page.choose_option("jog-axes", "at TABLE"), "its axes")
    page.press(PLUS_OF_X)
    give_time(LOOK_S)
    page.run("window.scrollTo(0, 0)")
    film.take("Straight along the axes of a taught place, drawn in the picture")
    page.let_go()
    keep(page, "pendant")


def look(page: Page, film: Film) -> None:
    """At the tabs that move nothing."""
    page.click("tab-scope")
    give_time(LOOK_S)
    film.take("Scope: tracking error and velocity, live; every cycle with a trigger")
    keep(page, "pendant_scope")
    page.click("tab-teach")
    page.click_at(".edit")
    film.take("Teach: record places, edit their numbers, go to them while you hold Go")
    keep(page, "pendant_teach")
    page.click("tab-board")
    wait_until(lambda: page.shows("#board-facts", "revision"), "the board")
    give_time(LOOK_S)
    film.take("Board: every register; faults for the emulated one")
    keep(page, "pendant_board")


def run_program(page: Page, film: Film, arm: RunningArm) -> None:
    """Off line, then live, stopped and led back."""
    page.click("tab-drive")
    page.click("take")
    wait_until(lambda: page.run("return pendant.armStatus.session === 'no'"), "let go")
    page.click("tab-programs")
    page.click_at(f'[data-name="{PROGRAM}"]')
    page.click("start-offline")
    wait_until(lambda: page.shows("#program-state", "done"), "off line")
    give_time(LOOK_S)
    film.take("Programs: off line first, where only a ghost moves")
    film.take()
    keep(page, "pendant_programs")
    page.click("start-live")
    film.take("Live: the page that drives has to confirm")
    page.click("start-sure")
    wait_until(lambda: page.shows("#mode", "TRACKING"), "live")
    page.click("tab-drive")
    page.choose_option("jog-axes", "base")
    give_time(LOOK_S)
    film.take("The program moves the arm; pause it, or slow it down")
    with ServoClient(arm.name) as servo:
        servo.stop()
    wait_until(lambda: page.flag(RobotFlag.PATH_WAITS), "it waits")
    film.take("Stopped: the program waits beside its path until somebody confirms")
    keep(page, "pendant_waits")
    page.click("pause")
    wait_until(lambda: not page.flag(RobotFlag.PATH_WAITS), "it goes back")
    film.take("Go back to the path: slowly, and then on along the same places")
    for _ in range(3):
        film.take()


if __name__ == "__main__":
    main()
