"""The results file of a study: only ever added to, gone on with, and never mixed."""

from __future__ import annotations

import errno
import fcntl
import json
from pathlib import Path

import pytest

from qrobot.errors import ConfigError
from qrobot.study.results import open_results, read_results

TERMS = {"study": "gains", "rate_hz": 1000.0}


def written(path: Path, *seeds: int) -> Path:
    with open_results(path, TERMS) as (results, _):
        for seed in seeds:
            results.add({"seed": seed, "x": seed * 0.5})
    return path


def test_outcomes_come_back_by_seed_with_the_terms(tmp_path: Path) -> None:
    found = read_results(written(tmp_path / "deep" / "r.jsonl", 2, 0, 1))
    assert found.terms == TERMS
    assert [outcome["seed"] for outcome in found.outcomes] == [0, 1, 2]


def test_an_outcome_is_on_the_disk_as_soon_as_it_is_added(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    with open_results(path, TERMS) as (results, done):
        assert done == frozenset()
        results.add({"seed": 7})
        assert [outcome["seed"] for outcome in read_results(path).outcomes] == [7]


def test_a_file_is_gone_on_with(tmp_path: Path) -> None:
    path = written(tmp_path / "r.jsonl", 0, 1)
    before = path.read_text()
    with open_results(path, TERMS) as (results, done):
        assert done == {0, 1}
        results.add({"seed": 2})
    assert path.read_text() == before + '{"seed":2}\n'


@pytest.mark.parametrize("torn", ['{"seed":3,"x"', '{"seed":3}', "\x00\x00"])
def test_a_line_that_was_torn_off_is_written_anew(tmp_path: Path, torn: str) -> None:
    path = written(tmp_path / "r.jsonl", 0)
    with path.open("a") as file:
        file.write(torn)
    assert [outcome["seed"] for outcome in read_results(path).outcomes] == [0]
    with open_results(path, TERMS) as (results, done):
        assert done == {0}
        results.add({"seed": 3, "x": 1.0})
    assert [json.loads(line) for line in path.read_text().splitlines()][-1] == {"seed": 3, "x": 1.0}


def test_a_file_whose_first_line_was_torn_off_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    path.write_text('{"study":')
    assert read_results(written(path, 4)).terms == TERMS


@pytest.mark.parametrize(
    "text", ['{"only":"copy"}', '{"study":"gains","rate', "a word", '{"study":"gains","rate_hz":5']
)
def test_a_file_without_a_whole_line_that_is_no_beginning_of_ours_is_left_alone(tmp_path: Path, text: str) -> None:
    path = tmp_path / "r.jsonl"
    path.write_text(text)
    ours = '{"study":"gains","rate_hz":1000.0}'.startswith(text)
    if ours:
        assert read_results(written(path, 4)).terms == TERMS
        return
    with (
        pytest.raises(ConfigError, match="holds something else than results of `qrobot study`: name another file"),
        open_results(path, TERMS),
    ):
        pass
    assert path.read_text() == text


def test_a_file_that_came_by_way_of_another_system_is_gone_on_with(tmp_path: Path) -> None:
    path = written(tmp_path / "r.jsonl", *range(40))
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n") + b'{"seed":40,"x"')
    written(path, 41)
    found = read_results(path)
    assert [outcome["seed"] for outcome in found.outcomes] == [*range(40), 41]


@pytest.mark.parametrize("line", ['{"seed":Infinity}', '{"seed":"x"}', "[1]"])
def test_outcomes_without_a_seed_are_no_results(tmp_path: Path, line: str) -> None:
    path = written(tmp_path / "r.jsonl", 0)
    with path.open("a") as file:
        file.write(line + "\n")
    with pytest.raises(ConfigError, match="is no results file"):
        read_results(path)


def test_results_of_other_terms_are_not_mixed_in(tmp_path: Path) -> None:
    path = written(tmp_path / "r.jsonl", 0)
    before = path.read_text()
    with (
        pytest.raises(ConfigError, match=r"holds results of another rate_hz: name another file"),
        open_results(path, TERMS | {"rate_hz": 2000.0}),
    ):
        pass
    assert path.read_text() == before


def test_two_runs_do_not_write_to_one_file(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    with (
        open_results(path, TERMS),
        pytest.raises(ConfigError, match="another run is writing"),
        open_results(path, TERMS),
    ):
        pass


def test_where_the_folder_knows_no_locks_results_are_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(_file: object, _operation: int) -> None:
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr(fcntl, "flock", no_locks)
    assert [outcome["seed"] for outcome in read_results(written(tmp_path / "r.jsonl", 0)).outcomes] == [0]


@pytest.mark.parametrize("text", ["", "hello\n", "[1]\n", '{"a":1}\n', '{"study":"gains"}\n{"x":1}\n', "{}\n{}\n"])
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "r.jsonl"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"is no results file of `qrobot study`"):
        read_results(path)


def test_a_file_that_is_not_there_or_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.jsonl"):
        read_results(tmp_path / "nowhere.jsonl")
    with pytest.raises(ConfigError, match="cannot write results"), open_results(tmp_path, TERMS):
        pass
