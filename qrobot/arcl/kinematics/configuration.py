"""The configuration word: which of the ways an arm takes to a pose, one bit field for each choice.

| bits | field | 0 | 1 |
|---|---|---|---|
| 0 | side | `r` right-hand | `l` left-hand |
| 1 | elbow | `u` up | `d` down |
| 2 | wrist | `n` no twist | `f` flipped |

It is the model's `Branch`, so an ARCL program and all other programs mean the same by "lun".
"""

from __future__ import annotations

from qrobot.errors import ConfigError, MotionError
from qrobot.model.branch import Branch, branch_of


def config_word(letters: str, default: int = 0) -> Branch:
    """The word of letters such as "lun"; a choice without a letter is as in `default`.

    Raises:
        MotionError: an unknown letter, or two for one choice.
    """
    if not isinstance(letters, str):
        raise MotionError(f'a configuration is named by letters, as in "lun", not {letters!r}')
    try:
        return branch_of(letters, Branch(default))
    except ConfigError as error:
        raise MotionError(str(error)) from error


def config_letters(word: int) -> str:
    """The letters of a word: one of each choice."""
    return Branch(word).letters
