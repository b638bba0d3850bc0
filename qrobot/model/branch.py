"""The eight ways in which a PUMA-like arm reaches a pose: the configuration letters of RCCL and ARCL.

| letters | names | meaning |
|---|---|---|
| `r` / `l` | right / left | looking out along the arm, it is on the right or left of the waist, as of a body |
| `u` / `d` | up / down | the elbow is above or below the line from shoulder to wrist |
| `n` / `f` | no-flip / flip | joint 5 is positive or negative (VAL's NOFLIP) |

The papers do not say which sign of joint 5 is `n`; this is VAL's, and it gives the published "run" and "lun" angles of
the nominal pose.
"""

from __future__ import annotations

from enum import IntFlag

from qrobot.errors import ConfigError


class Branch(IntFlag):
    """Three bits; none set is "run", as the arm stands at Paul's zero."""

    RUN = 0
    LEFT = 1
    DOWN = 2
    FLIP = 4

    @property
    def letters(self) -> str:
        """The branch in letters, as in "lun"."""
        return "".join(set_ if self & bit else unset for unset, set_, bit in _LETTERS)


_LETTERS = (("r", "l", Branch.LEFT), ("u", "d", Branch.DOWN), ("n", "f", Branch.FLIP))
ALL_BRANCHES = tuple(Branch(bits) for bits in range(8))


def branch_of(letters: str, default: Branch = Branch.RUN) -> Branch:
    """The branch that `letters` name; a pair without a letter is as in `default`.

    Raises:
        ConfigError: an unknown letter, or two of the same pair.
    """
    branch, left = default, letters
    for unset, set_, bit in _LETTERS:
        named = [letter for letter in letters if letter in (unset, set_)]
        if len(named) == 1:
            branch = branch | bit if named[0] == set_ else branch & ~bit
            left = left.replace(named[0], "")
    if left:
        raise ConfigError(f"configuration {letters!r}: at most one letter each of l/r, u/d and n/f")
    return branch
