"""The report of an identification: one HTML page with its figures inside, for people to judge a model by."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.identified import IdentifiedModel
from qrobot.errors import IdentificationError
from qrobot.ident.figures import predicted_figure, residuals_figure, structure_figure
from qrobot.ident.friction import FRICTION_NAMES, REMAINDER_NAMES
from qrobot.ident.model import Identified, rms_by_motor
from qrobot.ident.regressor import known_parameters
from qrobot.whole_file import replace_bytes, replace_file

DPI: Final = 110
_PAGE: Final = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }}
table {{ border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }}
th, td {{ padding: .15rem .9rem .15rem 0; text-align: right; border-bottom: 1px solid #ddd; }}
th:first-child, td:first-child, .words {{ text-align: left; }}
img {{ max-width: 100%; }} .dim {{ color: #777; }}
</style></head><body>
<h1>{title}</h1>
{body}
</body></html>
"""


def write_report(
    path: Path, found: Identified, model: IdentifiedModel, previous: IdentifiedModel | None = None
) -> list[Path]:
    """Write the page to `path` (.html) and its figures beside it (.png); returns all files.

    Args:
        path: of the page.
        found: what was identified.
        model: made of it.
        previous: another model of the same robot, to compare with.

    Raises:
        IdentificationError: a file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)  # before the figures are drawn, which takes seconds
        pictures = {path.with_name(f"{path.stem}-{name}.png"): _png(figure) for name, figure in _figures(found)}
        page = report_page(found, model, previous, list(pictures.values()))
        for file, picture in pictures.items():
            replace_bytes(file, picture)
        replace_file(path, page)
    except OSError as error:
        raise IdentificationError(f"cannot write the report to {path}: {error.strerror}") from error
    return [path, *pictures]


def _figures(found: Identified) -> Iterator[tuple[str, Figure]]:
    yield "predicted", predicted_figure(found)
    yield "residuals", residuals_figure(found)
    yield "structure", structure_figure(found)


def report_page(
    found: Identified, model: IdentifiedModel, previous: IdentifiedModel | None, pictures: Sequence[bytes]
) -> str:
    """The page as text."""
    images = [f'<img alt="" src="data:image/png;base64,{base64.b64encode(png).decode()}">' for png in pictures]
    parts = [_facts(found, model), _joints(found, model, previous), *images, _parameters(model, previous)]
    return _PAGE.format(title=f"Identification of {escape(model.robot)}, {model.date}", body="\n".join(parts))


def predicted_by(model: IdentifiedModel, found: Identified) -> Floats:
    """Torque that a model of the same robot predicts for what was observed, without load and drift. Shape (m,)."""
    robot, seen, unknowns = found.robot, found.observations, found.unknowns
    links = robot.links.model_copy(update={"mass": model.links.mass, "com": model.links.com})
    beta = found.base.K @ known_parameters(robot.model_copy(update={"links": links}), found.regressor)
    friction = np.column_stack([getattr(model.friction, name) for name in FRICTION_NAMES])
    scale = np.ones(robot.n) if model.drives is None else model.drives.torque_scale
    rubs = unknowns.friction_jacobian(seen.motor, seen.rate) @ friction.ravel()
    rubs += unknowns.stribeck_torque(seen.motor, seen.rate, _remainder(model, robot))
    return np.asarray(scale[seen.motor] * (seen.gravity @ beta) + rubs)


def _remainder(model: IdentifiedModel, robot: Robot) -> Floats:
    """Stribeck's remainders of a model; none of one that is older than they are. Shape (n, 2)."""
    told = {value.name: value.value for value in model.value}
    return np.array([[told.get(f"{joint}.{name}", 0.0) for name in REMAINDER_NAMES] for joint in robot.joint_names])


def _facts(found: Identified, model: IdentifiedModel) -> str:
    outliers, quality = found.fit.outliers.size, model.quality
    return (
        f"<p>{quality.observations} observations, of which {outliers} hardly count; condition {quality.condition:.1f}; "
        f"data {escape(model.data)}. {_unit(found)} Intervals hold the true value 19 times in 20.</p>"
        + "".join(f"<p>{escape(warning)}.</p>" for warning in found.warnings)
    )


def _unit(found: Identified) -> str:
    free, n = found.unknowns.free, found.robot.n
    if len(free) == n - 1:
        unit = next(name for motor, name in enumerate(found.robot.joint_names) if motor not in free)
        return f"Masses and moments are in the commanded torque of {escape(unit)}."
    return "Masses and moments are true ones." if free else "The robot file's torques were taken as true."


def _joints(found: Identified, model: IdentifiedModel, previous: IdentifiedModel | None) -> str:
    """Errors by joint: of passes held back, and of all passes without a load, by models alike."""
    names = found.robot.joint_names
    columns = {
        "held back, identified": found.held_back_rms,
        "held back, robot file": found.before_rms,
        "all without a load, identified": _error_of(model, found),
    }
    if previous is not None:
        columns["all without a load, previous model"] = _error_of(previous, found)
    rows = ([name, *(f"{column[j]:.3f}" for column in columns.values())] for j, name in enumerate(names))
    return "<h2>Error of predicted torque, N m (N), rms</h2>" + _table(["joint", *columns], rows)


def _error_of(model: IdentifiedModel, found: Identified) -> Floats:
    """Root mean square error of a model's prediction of the passes without a load, by motor. Shape (n,)."""
    seen = found.observations
    left, bare = seen.torque - predicted_by(model, found), ~seen.loaded
    return rms_by_motor(left[bare], seen.motor[bare], found.robot.n)


def _parameters(model: IdentifiedModel, previous: IdentifiedModel | None) -> str:
    old = {value.name: value for value in previous.value} if previous is not None else {}
    headings = ["parameter", "value", "95 %", "robot file", *(["previous model"] if old else []), "unit", "meaning"]
    rows = []
    for value in model.value:
        before = [_number(old[value.name].value) if value.name in old else ""] if old else []
        numbers = [_number(value.value), f"± {_number(value.half_width)}", _number(value.before)]
        rows.append([value.name, *numbers, *before, value.unit, value.meaning])
    return "<h2>Parameters</h2>" + _table(headings, rows)


def _number(value: float) -> str:
    return f"{value:.4f}"


def _table(headings: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in headings)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>\n" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table>"


def _png(figure: Figure) -> bytes:
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=DPI)
    return picture.getvalue()
