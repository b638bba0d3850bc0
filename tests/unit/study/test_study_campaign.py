"""A campaign: each arm once, whatever fails, whoever works, in whatever order."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest
from distributed import LocalCluster

from qrobot.errors import ConfigError, IdentificationError, LinkError
from qrobot.study.campaign import carry_out
from qrobot.study.engine import Engine, InProcess, engine
from qrobot.study.gains import GainStudy
from qrobot.study.results import read_results
from qrobot.study.study import ArmResult, Study, attempt, kept

HERE = Engine(InProcess(), 1, 1)
LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Squares(Study):
    """Arms of which the third is hopeless."""

    kind: ClassVar[str] = "squares"
    stops_at: int = -1

    def judge(self, seed: int) -> ArmResult:
        if seed == 3:
            raise IdentificationError("it does not move")
        if seed == self.stops_at:
            raise KeyboardInterrupt
        return {"square": seed**2}


def test_every_arm_has_its_outcome_and_a_failure_is_one(tmp_path: Path) -> None:
    found = carry_out(Squares(), 5, HERE, tmp_path / "r.jsonl")
    assert [outcome.get("square") for outcome in found.outcomes] == [0, 1, 4, None, 16]
    assert found.failed == [{"seed": 3, "failed": "IdentificationError: it does not move"}]
    assert [outcome["seed"] for outcome in found.good] == [0, 1, 2, 4]


@pytest.mark.parametrize("at_once", [1, 3, None])
def test_workers_and_order_change_nothing(tmp_path: Path, at_once: int | None) -> None:
    with ThreadPoolExecutor(3) as pool:
        found = carry_out(Squares(), 20, Engine(pool, at_once, 3), tmp_path / "pool.jsonl")
    assert found == carry_out(Squares(), 20, HERE, tmp_path / "here.jsonl")


def test_progress_counts_what_was_there_already(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    path = tmp_path / "r.jsonl"
    carry_out(Squares(), 2, HERE, path)
    carry_out(Squares(), 4, HERE, path, lambda done, total: told.append((done, total)))
    assert told == [(2, 4), (3, 4), (4, 4)]


def test_an_interrupted_run_keeps_what_it_has_and_the_next_one_does_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    interrupted = Squares(stops_at=2)
    with pytest.raises(KeyboardInterrupt):
        carry_out(interrupted, 5, HERE, path)
    assert [outcome["seed"] for outcome in read_results(path).outcomes] == [0, 1]
    path.write_text(path.read_text().replace('"stops_at":2', '"stops_at":-1'))
    before = path.read_text()
    assert len(carry_out(Squares(), 5, HERE, path).outcomes) == 5
    assert path.read_text().startswith(before)


def test_a_smaller_number_of_arms_looks_at_the_first_ones(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    carry_out(Squares(), 5, HERE, path)
    assert [outcome["seed"] for outcome in carry_out(Squares(), 2, HERE, path).outcomes] == [0, 1]


def test_terms_name_robot_and_program_and_change_with_them(tmp_path: Path) -> None:
    terms = Squares().terms
    assert {"study", "robot_file", "rate_hz", "robot", "code", "joints"} <= set(terms)
    assert Squares().terms == terms
    other = Squares(robot_file="stanford").terms
    assert {key for key in terms if terms[key] != other[key]} == {"robot_file", "robot", "joints"}


def test_a_worker_with_another_program_is_named_and_its_outcome_not_kept() -> None:
    study = Squares()
    with pytest.raises(ConfigError, match="has another code and robot than this one"):
        attempt(study, study.terms | {"code": "0", "robot": "1"}, 0)


def test_outcomes_of_two_versions_of_a_law_are_not_mixed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The law's path alone is the same before and after its file was edited."""
    monkeypatch.setattr(GainStudy, "judge", lambda _study, seed: {"seed": seed})
    law, path = tmp_path / "my_laws.py", tmp_path / "r.jsonl"
    law.write_text("gain = 1.0\n")
    study = GainStudy(law=f"{law}:mine")
    carry_out(study, 1, HERE, path)
    assert len(carry_out(study, 2, HERE, path).outcomes) == 2
    law.write_text("gain = 2.0\n")
    with pytest.raises(ConfigError, match="results of another law_text"):
        carry_out(study, 3, HERE, path)
    law.unlink()
    with pytest.raises(ConfigError, match="no law file"):
        carry_out(study, 3, HERE, path)
    assert "law_text" not in GainStudy().terms


def test_numbers_are_kept_with_six_digits() -> None:
    assert kept([[1.23456789, 0.0], [-1e-9 / 3.0, 2.0]]) == [[1.23457, 0.0], [-3.33333e-10, 2.0]]


def test_one_worker_is_this_process_and_none_is_an_error() -> None:
    with engine(1) as made:
        assert (made.at_once, made.workers) == (1, 1)
        assert made.executor.submit(pow, 2, 5).result() == 32
        with pytest.raises(ZeroDivisionError):
            made.executor.submit(divmod, 1, 0).result()
    with pytest.raises(ConfigError, match="at least 1"), engine(0):
        pass


def test_a_scheduler_that_does_not_answer_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qrobot.study.engine.PATIENCE_S", 0.3)
    with pytest.raises(LinkError, match=r"no Dask scheduler answers at tcp://127.0.0.1:1: start one"):
        engine(2, "tcp://127.0.0.1:1").__enter__()


def test_the_workers_of_a_running_scheduler_find_what_this_process_finds(tmp_path: Path) -> None:
    anywhere = f"{LOOPBACK}:0"
    running = LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        host=LOOPBACK,
        dashboard_address=anywhere,
        worker_dashboard_address=anywhere,
        local_directory=str(tmp_path),
    )
    with running as cluster, engine(1, cluster.scheduler_address) as theirs:
        assert theirs.workers == 2
        found = carry_out(Squares(), 5, theirs, tmp_path / "theirs.jsonl")
    assert found == carry_out(Squares(), 5, HERE, tmp_path / "here.jsonl")
