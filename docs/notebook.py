"""The notebook of an example whose cells are marked `# %%`, as editors and Jupytext know them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

EXAMPLES: Final = Path(__file__).parents[1] / "examples"
MARK: Final = re.compile(r"^# %%( \[markdown\])?\n", re.MULTILINE)
FORMAT: Final = {"nbformat": 4, "nbformat_minor": 5}
KERNEL: Final = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}


def notebook(name: str) -> str:
    """The example as a notebook that has not been run yet."""
    cells = list(_cells((EXAMPLES / name).read_text()))
    return json.dumps({"cells": cells, "metadata": KERNEL, **FORMAT}, indent=1, ensure_ascii=False) + "\n"


def _cells(program: str) -> Iterator[dict[str, Any]]:
    """What stands before the first mark, the docstring, is for the program only."""
    parts = MARK.split(program)[1:]
    for number, (kind, text) in enumerate(zip(parts[::2], parts[1::2], strict=True)):
        cell: dict[str, Any] = {"id": f"cell-{number}", "metadata": {}}
        words = re.sub("^# ?", "", text, flags=re.MULTILINE) if kind else text
        source = words.strip().splitlines(keepends=True)
        if kind:
            yield cell | {"cell_type": "markdown", "source": source}
        else:
            yield cell | {"cell_type": "code", "execution_count": None, "outputs": [], "source": source}
