"""The command line's switches, which begin with `+` (Corke & Kirkham, section 4), and what they turn on.

| switch | effect |
|---|---|
| `+tr` | print transforms as they are made |
| `+eq` | print position equations as they are made |
| `+m` | print motion requests, and when each is executed |
| `+ami NAME` | the machine layer, by name |
| `+aki NAME` | the kinematics layer, by name |
| `+s FILE` | write the diagnostic stream there |
| `+nolim` | off line only: joints without ranges |

`+tr` and `+m` are the paper's, the others ours [A].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from qrobot.errors import ConfigError

_FLAGS: Final = {"+tr": "transforms", "+eq": "equations", "+m": "motions", "+nolim": "unlimited"}
_VALUES: Final = {"+ami": "ami", "+aki": "aki", "+s": "stream"}


@dataclass
class Switches:
    """State of the switches.

    Attributes:
        transforms, equations, motions: what is printed.
        unlimited: joints have no ranges.
        ami, aki, stream: names of layers and of a file; empty for the default.
    """

    transforms: bool = False
    equations: bool = False
    motions: bool = False
    unlimited: bool = False
    ami: str = ""
    aki: str = ""
    stream: str = ""

    def take(self, argv: list[str]) -> None:
        """Obey the switches in `argv`, and take them out of it.

        Raises:
            ConfigError: an unknown switch, or one without its value.
        """
        rest: list[str] = []
        words = iter(list(argv))
        for word in words:
            if word in _FLAGS:
                setattr(self, _FLAGS[word], True)
            elif word in _VALUES:
                setattr(self, _VALUES[word], self._value(word, next(words, "")))
            elif word.startswith("+"):
                raise ConfigError(f"unknown switch {word!r}; ARCL knows {', '.join([*_FLAGS, *_VALUES])}")
            else:
                rest.append(word)
        argv[:] = rest

    def _value(self, switch: str, value: str) -> str:
        if not value or value.startswith("+"):
            raise ConfigError(f"the switch {switch} needs a value behind it")
        return value


switches: Final = Switches()
"""Those of this program: transforms and equations belong to no robot."""
