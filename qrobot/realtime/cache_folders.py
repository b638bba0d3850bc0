"""Folders of compiled code: one that can be written, and before it those that somebody else filled.

The first folder of this list that this account may write gets what is compiled: `$NUMBA_CACHE_DIR`, `__pycache__`
beside the source, `~/.cache/numba`. Those before it, an installation of another account or a folder of an image, are
read as well. Where none can be written, they are all there is.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any, Final

from numba.core import caching, config

_WRITABLE: Final[set[str]] = set()


class _TriedOnce:
    """A place that is tried by a file once for each folder, not for each of its kernels."""

    get_cache_path: Any

    def ensure_cache_path(self) -> None:
        """Raises OSError when the folder cannot be written."""
        path = self.get_cache_path()
        if path not in _WRITABLE or not os.path.isdir(path):
            super().ensure_cache_path()  # type: ignore[misc]
            _WRITABLE.add(path)


class _OnlyRead:
    """A place that is not tried at all."""

    def ensure_cache_path(self) -> None:
        """Leave it as it is."""


class _Chosen(_TriedOnce, caching.UserProvidedCacheLocator):  # type: ignore[misc]
    """`$NUMBA_CACHE_DIR`."""


class _BesideSource(_TriedOnce, caching.InTreeCacheLocator):  # type: ignore[misc]
    """`__pycache__`."""


class _OfUser(_TriedOnce, caching.UserWideCacheLocator):  # type: ignore[misc]
    """`~/.cache/numba`."""


class _ChosenOnlyRead(_OnlyRead, caching.UserProvidedCacheLocator):  # type: ignore[misc]
    """`$NUMBA_CACHE_DIR` of somebody else."""


class _BesideSourceOnlyRead(_OnlyRead, caching.InTreeCacheLocator):  # type: ignore[misc]
    """`__pycache__` of somebody else."""


class _Place(caching.CompileResultCacheImpl):  # type: ignore[misc]
    """Places in which code of a kernel is kept."""

    _locator_classes: Final = [_Chosen, _BesideSource, _OfUser, _ChosenOnlyRead, _BesideSourceOnlyRead]


class KernelCache(caching.FunctionCache):  # type: ignore[misc]
    """Numba's cache of one kernel in these folders. Raises RuntimeError or OSError for code without a file."""

    _impl_class = _Place

    @property
    def may_write(self) -> bool:
        """False where no folder can be written."""
        return not isinstance(self._impl.locator, _OnlyRead)

    def only_read(self) -> Iterator[str]:
        """Folders to read besides its own: those before the one that is written."""
        own = self._impl.locator.get_cache_path()
        for place in (_ChosenOnlyRead, _BesideSourceOnlyRead) if config.CACHE_DIR else (_BesideSourceOnlyRead,):
            folder = place(self._py_func, self._impl.locator._py_file).get_cache_path()
            if folder != own:
                yield folder
            elif self.may_write:
                return
