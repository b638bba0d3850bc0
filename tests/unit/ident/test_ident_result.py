"""The file of an identified model: what it holds, whom it fits, and when none is written."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.arms import controlled_robot
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config import load_robot
from qrobot.config.deployment import BoardChoice, BridgeChoice, DeployedArm, ServoChoice
from qrobot.config.identified import PRESET, IdentifiedDrives, IdentifiedModel, load_model, with_model
from qrobot.config.transport import PortTransport
from qrobot.errors import ConfigError, IdentificationError
from qrobot.ident.base import base_of_robot
from qrobot.ident.fit import Fit
from qrobot.ident.model import Identified, identify
from qrobot.ident.observe import none_of
from qrobot.ident.physical_gravity import nearest_links
from qrobot.ident.regressor import gravity_regressor, known_parameters
from qrobot.ident.result import doubt_poses, gravity_doubt, model_of, require_gravity_everywhere, write_model
from qrobot.ident.unknowns import Unknowns
from qrobot.log.header import header_for
from qrobot.log.record import write_log
from qrobot.model.dynamics import dynamics_params, with_payload
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N = PUMA.n
LOAD_KG = 1.2
NOTHING_RECORDED = (TelemetryLayout(N).empty(3), "2026-11-21")
FLANGE = np.array([0.0, 0.0, PUMA.geometry.flange_m])


@cache
def found() -> Identified:
    """A PUMA with a load in its hand and with the friction of another arm."""
    regressor = gravity_regressor(PUMA)
    base = base_of_robot(PUMA, regressor)
    theta = known_parameters(PUMA, regressor)
    theta[-4:] += LOAD_KG * np.array([1.0, *FLANGE])
    preset = PUMA.friction["akb"]
    friction = np.column_stack([preset.viscous, preset.coulomb_pos, preset.coulomb_neg])
    values = np.concatenate([base.K @ theta, friction.ravel(), np.zeros(3 * N)])
    fit = Fit(values, 1e-4 * np.eye(values.size), np.ones(N), np.zeros(1), np.ones(1), 3.0)
    unknowns = Unknowns(PUMA, regressor, base)
    return Identified(unknowns, fit, none_of(N, len(base.leading)), np.full(N, 0.1), np.full(N, 2.0), np.zeros(N))


def with_friction(sign: float, viscous: float | None = None) -> np.ndarray:
    """Values of which friction has a sign, and the waist a viscous friction of its own."""
    values, rubs = found().fit.values.copy(), slice(found().unknowns.n_weights, found().unknowns.n_weights + 3 * N)
    values[rubs] *= sign
    if viscous is not None:
        values[rubs.start] = viscous
    return values


@cache
def model() -> IdentifiedModel:
    return model_of(found(), TelemetryLayout(N).empty(3), "2026-11-21")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_model(tmp_path / "new" / "model.toml", model())
    return tmp_path / "new" / "model.toml"


def gravity_of(robot, q: np.ndarray) -> np.ndarray:
    regressor = gravity_regressor(PUMA)
    return regressor(q) @ known_parameters(robot, regressor)


def test_a_robot_with_its_model_has_the_gravity_found(file: Path) -> None:
    q = np.random.default_rng(1).uniform(PUMA.limits.q_min, PUMA.limits.q_max, (50, N))
    robot = with_model(PUMA, load_model(file, PUMA))
    np.testing.assert_allclose(gravity_of(robot, q), found().gravity(q), atol=1e-5)
    loaded = with_payload(dynamics_params(PUMA), LOAD_KG, FLANGE)
    assert robot.links.mass[-1] == pytest.approx(loaded.mass[-1], rel=0.25)
    assert (robot.links.mass > 0.0).all()


def test_friction_and_compensation_are_the_models(file: Path) -> None:
    robot = with_model(PUMA, load_model(file, PUMA))
    assert robot.control.friction_preset == PRESET
    np.testing.assert_allclose(robot.friction[PRESET].coulomb_pos, PUMA.friction["akb"].coulomb_pos)
    assert robot.control.gravity_joints.all()
    assert set(robot.friction) == {*PUMA.friction, PRESET}


def test_torque_scales_turn_torques_into_commands_and_friction_stays_as_commanded() -> None:
    scale = np.array([1.0, 0.8, 1.25, 1.0, 1.0, 1.5])
    drives = IdentifiedDrives.model_construct(torque_scale=scale)
    robot = with_model(PUMA, model().model_copy(update={"drives": drives}))
    commands = robot.transmission.dac_per_Nm
    np.testing.assert_allclose(commands, PUMA.transmission.dac_per_Nm * scale)
    as_commanded = robot.friction[PRESET].coulomb_pos * commands
    np.testing.assert_allclose(as_commanded, model().friction.coulomb_pos * PUMA.transmission.dac_per_Nm)
    assert (robot.guard.tau_max * np.abs(commands) <= 2048.0 + 1e-9).all()
    assert (robot.guard.tau_max <= PUMA.guard.tau_max).all()


def test_a_model_from_before_there_were_torque_scales_is_read(file: Path) -> None:
    lines = file.read_text().splitlines(keepends=True)
    at = lines.index("[drives]\n")
    file.write_text("".join(lines[:at] + lines[at + 2 :]))
    robot = with_model(PUMA, load_model(file, PUMA))
    np.testing.assert_array_equal(robot.transmission.dac_per_Nm, PUMA.transmission.dac_per_Nm)


def test_a_file_keeps_values_intervals_date_and_quality(file: Path) -> None:
    read = load_model(file, PUMA)
    assert (read.date, read.robot, read.quality.condition) == ("2026-11-21", "puma560", 3.0)
    assert read.value == model().value
    by_name = {value.name: value for value in read.value}
    assert by_name["hx2"].half_width == pytest.approx(1.96 * 0.01, rel=1e-3)
    assert by_name["waist.coulomb_neg"].value == 6.3


def test_a_model_of_another_robot_is_refused(file: Path) -> None:
    with pytest.raises(ConfigError, match="identified on robot 'puma560', not on 'stanford'"):
        load_model(file, load_robot("stanford"))


def test_a_model_is_refused_once_the_geometry_has_changed(file: Path) -> None:
    longer = PUMA.geometry.model_copy(update={"a_m": PUMA.geometry.a_m * 1.01})
    with pytest.raises(ConfigError, match="changed since: identify it again"):
        load_model(file, PUMA.model_copy(update={"geometry": longer}))


def test_a_damaged_model_names_its_mistakes(file: Path) -> None:
    file.write_text(file.read_text().replace("viscous = ", "viscuos = "))
    with pytest.raises(ConfigError, match="did you mean 'viscous'"):
        load_model(file, PUMA)


def arm_with(model_path: str | None) -> DeployedArm:
    servo = ServoChoice(model=model_path)
    return DeployedArm(name="left", robot="puma560", servo=servo, bridge=BridgeChoice(port=5999))


def test_a_servo_takes_the_model_its_file_names(file: Path) -> None:
    robot, used = controlled_robot(arm_with(str(file)))
    assert (robot.control.friction_preset, used) == (PRESET, str(file))


def test_a_model_that_does_not_fit_is_told_and_the_robot_file_used(capsys: pytest.CaptureFixture[str]) -> None:
    robot, used = controlled_robot(arm_with("nowhere.toml"))
    assert (robot.control.friction_preset, used) == (PUMA.control.friction_preset, "")
    assert "the identified model of left is not used" in capsys.readouterr().err


def test_a_model_of_an_emulated_arm_is_not_used_for_a_real_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "model.toml"
    write_model(file, model_of(found(), *NOTHING_RECORDED, plant="nominal"))
    emulated = arm_with(str(file))
    real = emulated.model_copy(update={"board": BoardChoice(kind="port", port=PortTransport(base=0x300))})
    assert controlled_robot(emulated)[1] == str(file)
    robot, used = controlled_robot(real)
    assert (robot.control.friction_preset, used) == (PUMA.control.friction_preset, "")
    assert "was identified on an emulated arm (plant 'nominal')" in " ".join(capsys.readouterr().err.split())
    with pytest.raises(ConfigError, match=r"and .* is a real one: record it"):
        controlled_robot(real, str(file))
    assert controlled_robot(real, str(file), emulated=True)[1] == str(file)  # in lock-step


def test_a_model_asked_for_by_name_has_to_fit(file: Path) -> None:
    assert controlled_robot(arm_with("nowhere.toml"), str(file))[1] == str(file)
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        controlled_robot(arm_with(str(file)), "nowhere.toml")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"held_back_rms": np.array([0.1, 3.1, 0.1, 0.1, 0.1, 0.1])}, "predicts shoulder worse than the robot file"),
        ({"held_back_rms": np.array([np.nan, *np.zeros(5)])}, "no held-back pass turns waist"),
        (
            {"fit": replace(found().fit, values=with_friction(-1.0))},
            "friction of waist, .* pushes: the sign of its torque",
        ),
        ({"fit": replace(found().fit, values=with_friction(1.0, -0.1))}, "friction of waist comes out negative"),
    ],
)
def test_what_would_make_the_servo_worse_is_not_written(change: dict, complaint: str) -> None:
    with pytest.raises(IdentificationError, match=complaint):
        model_of(replace(found(), **change), TelemetryLayout(N).empty(3), "2026-11-21")


def test_a_model_that_is_as_good_as_the_robot_file_within_its_uncertainty_is_written() -> None:
    rows, small = TelemetryLayout(N).empty(3), np.full(N, 1e-4)
    model_of(replace(found(), held_back_rms=3.0 * small, before_rms=small), rows, "2026-11-21")  # less than a step
    doubtful = replace(found(), held_back_rms=np.full(N, 3.1), held_back_doubt=np.ones(N))
    model_of(replace(doubtful, before_rms=np.full(N, 2.0)), rows, "2026-11-21")
    with pytest.raises(IdentificationError, match="worse than the robot file"):
        model_of(replace(doubtful, before_rms=np.full(N, 1.0)), rows, "2026-11-21")


@pytest.mark.parametrize("times", [1.05, 1.2, 1.49])
@pytest.mark.parametrize("joint", range(N))
def test_a_model_that_is_a_little_worse_than_the_robot_file_on_one_joint_is_not_written(
    times: float, joint: int
) -> None:
    errors = np.full(N, 2.0)
    errors[joint] *= times
    with pytest.raises(IdentificationError, match=f"predicts {PUMA.joint_names[joint]} worse than the robot file"):
        model_of(replace(found(), held_back_rms=errors, before_rms=np.full(N, 2.0)), *NOTHING_RECORDED)


def test_an_arm_that_is_exactly_as_its_file_says_gets_a_model() -> None:
    regressor, base = puma_base()
    preset = PUMA.friction[PUMA.control.friction_preset]
    friction = np.column_stack([preset.viscous, preset.coulomb_pos, preset.coulomb_neg])
    for seed in range(5):
        seen = generated(base.K @ known_parameters(PUMA, regressor), friction, 1e-4, seed)
        model_of(identify(PUMA, base, regressor, seen), TelemetryLayout(N).empty(3), "2026-11-21")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("none", [[0], [1, 2], [0, 1, 2]])
def test_an_arm_without_viscous_or_coulomb_friction_gets_a_model(none: list[int]) -> None:
    regressor, base = puma_base()
    below = False
    for seed in range(3):
        beta, friction = drawn(seed)
        friction[:, none] = 0.0
        found = identify(PUMA, base, regressor, generated(beta, friction, 0.02, seed))
        below |= bool((found.friction < 0.0).any())
        given = model_of(found, TelemetryLayout(N).empty(3), "2026-11-21").friction
        assert min(given.viscous.min(), given.coulomb_pos.min(), given.coulomb_neg.min()) == 0.0
    assert below


def test_coulomb_friction_clearly_below_nothing_is_refused() -> None:
    values = found().fit.values.copy()
    values[found().unknowns.n_weights + 1] = -0.06  # of the waist: 0.0196 is its half width, half a step 0.025 N m
    doubtful = replace(found().fit, values=values)
    with pytest.raises(IdentificationError, match="friction of waist comes out negative"):
        model_of(replace(found(), fit=replace(doubtful, covariance=0.5 * doubtful.covariance)), *NOTHING_RECORDED)
    given = model_of(replace(found(), fit=doubtful), *NOTHING_RECORDED)
    assert given.friction.coulomb_pos[0] == 0.0
    assert {value.name: value.value for value in given.value}["waist.coulomb_pos"] == -0.06


@pytest.mark.thorough
@pytest.mark.parametrize("within", [0.01, 0.03])
def test_passes_that_are_too_much_alike_to_tell_gravity_elsewhere_make_no_model(within: float) -> None:
    regressor, base = puma_base()
    for seed in range(3):
        found = identify(PUMA, base, regressor, generated(*drawn(seed), 0.05, seed, within=within))
        assert (found.held_back_rms < 0.2 * found.before_rms).any()  # where it was recorded it is a good one
        with pytest.raises(IdentificationError, match=r"hardly told away from the poses of the logs: ± \d"):
            require_gravity_everywhere(found)
    require_gravity_everywhere(identify(PUMA, base, regressor, generated(*drawn(0), 0.05, 0)))


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_doubt_of_gravity_is_what_models_of_other_recordings_differ_by(noise: float) -> None:
    """In 95 of 100, at any pose; a recording of the whole range leaves little."""
    regressor, base = puma_base()
    beta, friction = drawn(1)
    within = 0
    for seed in range(8):
        found = identify(PUMA, base, regressor, generated(beta, friction, noise, seed), known_torque=True)
        doubts, poses = gravity_doubt(found), doubt_poses(PUMA)
        off = base.columns(regressor(poses)) @ (found.beta - beta) @ np.linalg.inv(PUMA.transmission.coupling)
        within += np.count_nonzero(np.abs(off).max(axis=0) <= 1.5 * doubts.max(axis=0) + 1e-9)
        assert (doubts.max(axis=0) < 0.02 * PUMA.guard.tau_max).all()
    assert within >= 0.9 * 8 * N


def test_logs_with_the_load_and_without_it_that_changed_places_make_no_model() -> None:
    regressor, base = puma_base()
    beta, friction = drawn(4, load_kg=0.0)
    heavy, light = generated(beta, friction, 0.02, 4, load_kg=2.0), generated(beta, friction, 0.02, 5, poses=12)
    told = [replace(each, loaded=np.full(len(each), loaded)) for each, loaded in ((heavy, False), (light, True))]
    found = identify(PUMA, base, regressor, told[0].followed_by(told[1]))
    with pytest.raises(IdentificationError, match=r"the load weighs -2\.\d+ ± .* Change them round"):
        model_of(found, *NOTHING_RECORDED)


def test_gravity_no_arm_has_is_refused() -> None:
    beta = found().beta.copy()
    beta[0] = -30.0
    with pytest.raises(IdentificationError, match="no links with positive masses"):
        nearest_links(PUMA, found().base, beta)


def test_links_of_an_arm_that_is_as_its_file_says_are_the_files() -> None:
    base, regressor = found().base, found().regressor
    mass, com = nearest_links(PUMA, base, base.K @ known_parameters(PUMA, regressor))
    np.testing.assert_allclose(mass, PUMA.links.mass, atol=1e-6)
    np.testing.assert_allclose(com, PUMA.links.com, atol=1e-6)


def test_a_model_is_shown_with_its_intervals(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["identify", "show", str(file)]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["waist.coulomb_neg", "6.3000", "±", "0.0196", "27.2400", "N", "m"] in lines
    assert ["shoulder", "0.100", "2.000"] in lines
    assert run_app(make_app(), ["identify", "show", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["robot"] == "puma560"


def test_a_plan_is_shown_and_nothing_moves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["identify", "record", "--output", str(tmp_path / "run.mcap"), "--poses", "12"]
    assert run_app(make_app(), command) == 1
    said = capsys.readouterr()
    assert "waist at 70 %" in " ".join(said.out.split())
    assert "nothing has moved" in said.err
    assert not list(tmp_path.iterdir())


def test_a_plan_as_json_says_what_can_be_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["identify", "plan", "--poses", "12", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["swings"]) == 12 + 3 * N
    assert told["parameters"]["hy5"] == "hy5 - hz6"
    assert "m1" in told["untold"]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["fit", "x.mcap", "--output", "m.toml", "--load-kg", "2"], "needs a mass above zero, and --loaded"),
        (["record", "--output", "x.mcap", "--go", "--load-kg", "2"], "--load-kg is for an emulated arm"),
        (["friction"], "name at least one log"),
        (
            ["fit", "x.mcap", "--output", "m.toml", "--date", "nonsense"],
            "--date nonsense: wanted is a day as YYYY-MM-DD",
        ),
        (["fit", "x.mcap", "--output", "m.toml", "--date", "2026-02-30"], "YYYY-MM-DD, such as 2026-11-21"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    options: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_app(make_app(), ["identify", *options]) == 1
    assert complaint in " ".join(capsys.readouterr().err.split())


def test_a_log_of_an_arm_at_rest_tells_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "rest.mcap", TelemetryLayout(N).empty(500), header_for(PUMA, 1_000_000, "qrobot"))
    command = ["identify", "fit", str(tmp_path / "rest.mcap"), "--output", str(tmp_path / "model.toml")]
    assert run_app(make_app(), command) == 1
    assert "nothing recorded moves steadily" in capsys.readouterr().err
    assert not (tmp_path / "model.toml").exists()


@pytest.mark.parametrize(("within", "writes"), [(1.0, True), (0.03, False)])
def test_fit_asks_before_it_writes_and_tells_plant_and_load(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, within: float, writes: bool
) -> None:
    rows = TelemetryLayout(N).empty(3)
    rows["payload"][:, 0] = 2.0
    log = write_log(tmp_path / "run.mcap", rows, header_for(PUMA, 1_000_000, "qrobot", plant="mismatched"))[0]
    regressor, base = puma_base()
    seen = identify(PUMA, base, regressor, generated(*drawn(0), 0.05, 0, within=within))
    monkeypatch.setattr("qrobot.cli.identify_fit.identify_log", lambda *_: seen)
    status = run_app(make_app(), ["identify", "fit", str(log), "--output", str(tmp_path / "model.toml")])
    said = " ".join(capsys.readouterr().err.split())
    assert (status, (tmp_path / "model.toml").exists()) == ((0, True) if writes else (1, False))
    assert ("the servo was told 2 kg while this was recorded" in said) is writes
    assert ("hardly told away from the poses of the logs" in said) is not writes
    if writes:
        assert load_model(tmp_path / "model.toml", PUMA).plant == "mismatched"
