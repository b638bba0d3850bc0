"""Hand the arms of a study to an engine, and keep what comes back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, wait
from itertools import islice
from pathlib import Path

from qrobot.study.engine import Engine
from qrobot.study.results import Results, open_results, read_results
from qrobot.study.study import ArmResult, Study, attempt

Told = Callable[[int, int], None]
"""Called with the number of arms that are done and of all, each time one comes in."""


def carry_out(study: Study, arms: int, engine: Engine, path: Path, told: Told = lambda _done, _all: None) -> Results:
    """Outcomes of the arms 0 to `arms` - 1, those that the file at `path` has already included.

    Whoever works, in whatever order: the outcome of an arm depends on its number alone.

    Raises:
        ConfigError: the file is of another study, or a worker has another program or robot file.
    """
    terms = study.terms
    with open_results(path, terms) as (results, done):
        missing = [seed for seed in range(arms) if seed not in done]
        told(arms - len(missing), arms)
        for number, outcome in enumerate(_outcomes(study, terms, missing, engine), 1):
            results.add(outcome)
            told(arms - len(missing) + number, arms)
    found = read_results(path)
    return Results(found.terms, tuple(outcome for outcome in found.outcomes if outcome["seed"] < arms))


def _outcomes(study: Study, terms: ArmResult, seeds: Iterable[int], engine: Engine) -> Iterator[ArmResult]:
    """Outcomes in the order in which they come in."""
    waiting = iter(seeds)
    running = {engine.executor.submit(attempt, study, terms, seed) for seed in islice(waiting, engine.at_once)}
    while running:
        done, running = wait(running, return_when=FIRST_COMPLETED)
        for future in done:
            yield future.result()
            running |= {engine.executor.submit(attempt, study, terms, seed) for seed in islice(waiting, 1)}
