"""A film of the pendant's page: its pictures one after the other, with a line of text below each."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Final

import matplotlib as mpl
from PIL import Image, ImageDraw, ImageFont

from tests.support.browser import Page
from tests.support.patience import give_time

IMAGES: Final = Path(__file__).parent / "images"
COLOURS: Final = 96  # of a picture: pages are plain
FONT: Final = Path(mpl.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"
FILM_WIDTH, CAPTION, LETTERS, FILM_COLOURS = 760, 34, 17, 128  # pixels, and colours
READ_MS, NEXT_MS = 4500, 800  # of a picture with a new caption, of the next one
SETTLED_S: Final = 0.4


class Film:
    """Pictures of a page with a line of text below each."""

    def __init__(self, page: Page) -> None:
        self._page, self._caption = page, ""
        self._pictures: list[Image.Image] = []
        self._lengths: list[int] = []

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        return sum(self._lengths) / 1000

    def take(self, caption: str = "", at: str = "") -> None:
        """What the window shows now, from its top or around a selector; without a caption that of before stays."""
        self._lengths.append(READ_MS if caption else NEXT_MS)
        self._caption = caption or self._caption
        page = whole(self._page, at)
        shown = page.resize((FILM_WIDTH, page.height * FILM_WIDTH // page.width), Image.Resampling.LANCZOS)
        picture = Image.new("RGB", (FILM_WIDTH, shown.height + CAPTION), "#17212c")
        picture.paste(shown)
        font = ImageFont.truetype(str(FONT), LETTERS)
        ImageDraw.Draw(picture).text((10, shown.height + 6), self._caption, "white", font)
        self._pictures.append(picture)

    def follow(self, pictures: int) -> None:
        """The same caption for some more pictures."""
        for _ in range(pictures):
            self.take()

    def write(self, path: Path) -> None:
        """Write it as GIF, with the colours of its first picture and of the last."""
        both = Image.new("RGB", (FILM_WIDTH, 2 * self._pictures[0].height))
        both.paste(self._pictures[0])
        both.paste(self._pictures[-1], (0, self._pictures[0].height))
        palette = both.quantize(FILM_COLOURS, dither=Image.Dither.NONE)
        first, *others = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in self._pictures)
        first.save(path, save_all=True, append_images=others, duration=self._lengths, loop=0, optimize=True)


def whole(page: Page, at: str = "") -> Image.Image:
    """What a window shows, from its top or around a selector, without the newest line for people."""
    scroll = f"document.querySelector('{at}').scrollIntoView({{block: 'center'}})" if at else "window.scrollTo(0, 0)"
    page.run(f"document.querySelector('.dismiss').click(); {scroll}")
    give_time(SETTLED_S)
    return Image.open(BytesIO(page.window_picture())).convert("RGB")


def keep(page: Page, name: str) -> None:
    """Write what a window shows into the folder of pictures."""
    picture = whole(page).quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(IMAGES / f"{name}.png", optimize=True)
