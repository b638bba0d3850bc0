"""A key of a terminal as a dead man's switch: a terminal tells no release, but repeats the character of a held key.

    free --a character--> pressed --the same, later--> held --none for a while, or another--> let go --silence--> free

The first repeat comes late, so one stroke moves nothing: a key is held from its first repeat on. One that was let go
stays so until all keys have been silent for a while; characters that come late start nothing again.
"""

from __future__ import annotations

from itertools import groupby
from typing import Final

FIRST_MS: Final = 1000.0  # [A] in which the first repeat comes: terminals wait 200 to 700 ms
REPEAT_MS: Final = 120.0  # [A] between two others: terminals repeat 15 to 40 times a second
SILENCE_MS: Final = 250.0  # [A] until a key that was let go may be pressed anew

_FREE, _PRESSED, _HELD, _LET_GO = range(4)


class HeldKey:
    """Follows what is typed.

    Attributes:
        pressed: keys that have been pressed, in order; whoever obeys them takes them out.
    """

    def __init__(self) -> None:
        self.pressed: list[str] = []
        self._state, self._key, self._heard_ms = _FREE, "", 0.0

    def hear(self, characters: str, now_ms: float) -> str:
        """Take what was typed since the last call; the key that is held now, "" for none.

        Of a character that came several times at once, as after a pause of the reader, one counts.
        """
        self._pass_time(now_ms)
        for key, _ in groupby(characters):
            self._take(key, now_ms)
        return self._key if self._state == _HELD else ""

    def _take(self, key: str, now_ms: float) -> None:
        repeated, self._heard_ms = key == self._key, now_ms
        if self._state == _FREE or (self._state == _PRESSED and not repeated):
            self._state, self._key = _PRESSED, key
            self.pressed.append(key)
        elif self._state == _PRESSED:
            self._state = _HELD
        elif self._state == _HELD and not repeated:
            self._state = _LET_GO

    def _pass_time(self, now_ms: float) -> None:
        silent_ms = now_ms - self._heard_ms
        if self._state == _HELD and not silent_ms <= REPEAT_MS:
            self._state = _LET_GO
        if (self._state == _PRESSED and not silent_ms <= FIRST_MS) or (
            self._state == _LET_GO and not silent_ms <= SILENCE_MS
        ):
            self._state, self._key = _FREE, ""
