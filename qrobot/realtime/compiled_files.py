"""Files of compiled code: damaged ones are not read, none is kept on a full disk, each kind of processor has its own.

Numba trusts its cache: an index that cannot be read, half a file or a full disk ends the call of the kernel, with the
arm behind it. Here whatever is not whole counts as not there, and what cannot be kept is compiled again next time.
Processors of several kinds may share a folder over a network, where locks are not to be relied on: they share no file.
"""

from __future__ import annotations

import hashlib
import pickle
import warnings
from collections import defaultdict
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any, Final

import llvmlite.binding as llvm
from numba.core import config
from numba.core.caching import IndexDataCacheFile

from qrobot.realtime.cache_folders import KernelCache

DIGEST_BYTES: Final = hashlib.sha256().digest_size
USED_FOLDERS: Final[defaultdict[str, set[str]]] = defaultdict(set)  # and in each the kernels read or kept so far


class CompiledFiles(IndexDataCacheFile):  # type: ignore[misc]
    """Index and code of one kernel.

    Args:
        folder: of the cache. name: of the kernel, as Numba spells it. stamp: of the sources, see `source_digest`.
        filled: folders of others, where code is looked for as well.
    """

    def __init__(self, folder: str, name: str, stamp: str, filled: Iterable[str] = ()) -> None:
        super().__init__(folder, f"{name}.{processor_digest()}", stamp)
        self.folder = folder
        self.filled = [CompiledFiles(each, name, stamp) for each in filled]

    def save(self, key: Any, data: Any) -> None:
        """Keep code under its key: signature, processor and contents of the kernel."""
        super().save(key, (key, data))
        USED_FOLDERS[self.folder].add(self._index_name)

    def load(self, key: Any) -> Any:
        """The code under a key; None when there is none, or the file that is to hold it has another's."""
        found, data = super().load(key) or (None, None)
        if found == key:
            USED_FOLDERS[self.folder].add(self._index_name)
            return data
        return next(filter(None, (files.load(key) for files in self.filled)), None)

    @property
    def is_empty(self) -> bool:
        """True when no folder has code of this kernel as it is now."""
        return not self._load_index() and all(files.is_empty for files in self.filled)

    def _load_index(self) -> dict[Any, str]:
        try:
            return dict(self._read(Path(self._index_path)))
        except OSError:
            return {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, overloads)

    def _load_data(self, name: str) -> Any:
        """Raises OSError, which Numba takes for a file that is not there."""
        return self._read(Path(self._data_path(name)))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, contents: Any) -> None:
        written = self._dump(contents)
        with self._open_for_write(path) as file:
            file.write(self._digest(Path(path).name, written) + written)

    def _read(self, path: Path) -> Any:
        """Contents of a file. Raises OSError when it is missing, not whole, or of another kernel or version of one."""
        read = path.read_bytes()
        digest, written = read[:DIGEST_BYTES], read[DIGEST_BYTES:]
        if digest != self._digest(path.name, written):
            raise OSError(f"{path} is not whole, or of another name or other sources")
        try:
            return pickle.loads(written)
        except Exception as error:  # whole, but it names what is no more: any error is possible
            raise OSError(f"{path} cannot be read: {error}") from error

    def _digest(self, name: str, written: bytes) -> bytes:
        about = f"{self._version} {name} {self._source_stamp} "
        return hashlib.sha256(about.encode() + written).digest()


@cache
def processor_digest() -> str:
    """Eight digits for the processor that code is made for."""
    name = config.CPU_NAME or llvm.get_host_cpu_name()
    features = llvm.get_host_cpu_features().flatten() if config.CPU_FEATURES is None else config.CPU_FEATURES
    return hashlib.sha256(f"{name} {features}".encode()).hexdigest()[:8]


def keep_in_files(dispatcher: Any, cache: KernelCache, stamp: str) -> None:
    """Let compiled code of `dispatcher` be kept in `CompiledFiles`, where there is a folder for it."""
    save_now = cache.save_overload

    def save_overload(signature: Any, result: Any) -> None:
        try:
            if cache.may_write:
                save_now(signature, result)
        except OSError as error:
            text = f"compiled code cannot be kept in {cache.cache_path}: {error}; the next start compiles it again"
            warnings.warn(text, RuntimeWarning, stacklevel=2)

    cache._cache_file = CompiledFiles(cache.cache_path, cache._impl.filename_base, stamp, cache.only_read())
    cache.save_overload = save_overload
    dispatcher._cache = cache
