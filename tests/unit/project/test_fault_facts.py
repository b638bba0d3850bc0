"""The page of faults claims no reaction that nothing raises, and no test that does not exist."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path

import pytest

from qrobot.faultcodes import FaultCode
from tests.property.test_fault_campaign import CASES, MISHAPS

ROOT = Path(__file__).parents[3]
REFRESH = runpy.run_path(str(ROOT / "docs/refresh.py"))
FACTS = REFRESH["fault_facts"].FACTS
BREAKS, STREAM = REFRESH["fault_facts"].BREAKS, REFRESH["fault_facts"].STREAM
RAISED = REFRESH["tables"].raised_codes()


@pytest.mark.parametrize("code", FACTS, ids=lambda code: code.name)
def test_a_fault_on_the_page_is_raised_and_its_test_exists(code: FaultCode) -> None:
    assert code.name in RAISED
    path, _, function = FACTS[code].test.partition("::")
    tree = ast.parse((ROOT / path).read_text())
    assert function in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_a_fault_that_the_campaign_is_said_to_inject_is_named_in_its_table() -> None:
    injected = {test: {code for code, fact in FACTS.items() if fact.test == test} for test in (BREAKS, STREAM)}
    assert injected[BREAKS] - {FaultCode.RESET_DENIED} <= {code for case in CASES for code in case.codes + case.ends}
    assert injected[STREAM] <= {mishap.code for mishap in MISHAPS}


def test_every_code_raised_has_its_row() -> None:
    page = REFRESH["PARTS"]["reactions"]()
    assert {line.split()[1] for line in page.splitlines()[2:]} == RAISED - {"NONE"}


def test_every_row_stands_by_itself() -> None:
    """They are sorted by number: none may refer to the one above it."""
    assert [code.name for code, fact in FACTS.items() if "likewise" in fact.bound] == []
