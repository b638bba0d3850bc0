"""The transform data base of RCCL: transforms by name in a file (Hayward & Paul, "Introduction to RCCL", 4.3)."""

from __future__ import annotations

from qrobot.errors import ConfigError
from qrobot.motion import Trsf
from qrobot.rccl.transforms import Transform, assigntr, hold, made_transform
from qrobot.transform_file import TransformFile


class DataBase(TransformFile):
    """Transforms by name.

    Args:
        path: of the file; it need not exist yet.
    """

    def get(self, name: str, kind: str = hold) -> Transform:
        """The transform of that name, of kind "const", "varb" or "hold".

        A goal that is "varb" is followed: it obeys no override and no pause.

        Raises:
            ConfigError: there is none, or a line cannot be read.
        """
        values = self.values()
        if name not in values:
            known = ", ".join(values) or "nothing"
            raise ConfigError(f"{self._path}: no transform {name!r}; it has {known}")
        return made_transform(name, kind, values[name])

    def read(self, trsf: Transform) -> bool:
        """Give `trsf` the value recorded under its name; False when there is none."""
        if (value := self.values().get(trsf.name)) is None:
            return False
        assigntr(trsf, Trsf(trsf.name, value=value))
        return True

    def record(self, trsf: Trsf) -> None:
        """Put a transform, as it is now, under its name; raises what `write` raises."""
        self.write(trsf.name, trsf.value)
