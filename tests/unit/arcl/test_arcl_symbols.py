"""The transform symbol table (E-24): by name, to and from a file that RCCL reads as well."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl import (
    HOLD,
    new_trans,
    new_trans_rpy,
    new_trans_tr,
    sym_delete,
    sym_dump,
    sym_enter,
    sym_load,
    sym_lookup,
    sym_names,
)
from qrobot.errors import ConfigError, MotionError
from qrobot.rccl import DataBase


@pytest.fixture(autouse=True)
def _empty() -> Iterator[None]:
    """The table is that of the process: other tests may have left something in it."""
    _forget_all()
    yield
    _forget_all()


def _forget_all() -> None:
    for name in sym_names():
        sym_delete(name)


def test_a_transform_is_found_by_its_name() -> None:
    stand = sym_enter(new_trans_tr("stand", 600, 100, 500))
    assert sym_lookup("stand") is stand
    assert (sym_names(), sym_lookup("work")) == (["stand"], None)
    assert (sym_delete("stand"), sym_delete("stand")) == (True, False)
    with pytest.raises(MotionError):
        sym_enter("stand")  # type: ignore[arg-type]


def test_a_table_that_was_dumped_comes_back(tmp_path: Path) -> None:
    made = [sym_enter(new_trans_rpy(name, 10 * k, -20, 30, 40, 50 - k, 60)) for k, name in enumerate("abc")]
    assert sym_dump(tmp_path / "taught") == 3
    for trans in made:
        sym_delete(trans.name)
    assert sym_load(tmp_path / "taught", HOLD) == 3
    for trans in made:
        found = sym_lookup(trans.name)
        assert found is not None
        assert found is not trans
        assert found.kind is HOLD
        assert np.allclose(found.value, trans.value, atol=1e-8)


def test_a_transform_that_is_there_gets_the_value_and_stays_the_same_object(tmp_path: Path) -> None:
    sym_enter(new_trans_tr("stand", 1, 2, 3))
    sym_dump(tmp_path / "taught")
    sym_delete("stand")
    stand = sym_enter(new_trans("stand"))
    sym_load(tmp_path / "taught")
    assert sym_lookup("stand") is stand
    assert list(stand.t_p) == pytest.approx([1, 2, 3])


def test_the_file_is_the_data_base_of_rccl_and_keeps_what_else_stands_there(tmp_path: Path) -> None:
    path = tmp_path / "taught"
    path.write_text("# by hand\nbench 1 2 3 0 0 0  # do not touch\n")
    sym_enter(new_trans_tr("stand", 600, 100, 500))
    sym_dump(path)
    assert DataBase(path).names() == ["bench", "stand"]
    assert [*DataBase(path).get("stand").p] == pytest.approx([600, 100, 500])
    assert "# do not touch" in path.read_text()


def test_a_file_or_a_name_that_cannot_be_changes_nothing(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        sym_load(tmp_path / "none")
    (tmp_path / "bad").write_text("a 1 2 3 0 0 0\nb 1 2\n")
    with pytest.raises(ConfigError, match="line 2"):
        sym_load(tmp_path / "bad")
    assert sym_names() == []
    sym_enter(new_trans_tr("good", 1, 2, 3))
    sym_enter(new_trans_tr("two words", 1, 2, 3))
    with pytest.raises(ConfigError, match="without spaces"):
        sym_dump(tmp_path / "new")
    assert not (tmp_path / "new").exists()
