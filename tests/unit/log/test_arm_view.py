"""What viewers get of a log: the frames are those of the kinematics, at 50 Hz, on the wall clock, in every part."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from qrobot.config import Robot, load_robot
from qrobot.config.fences import Fence
from qrobot.config.shape import Capsule
from qrobot.fences.told_fences import ToldFences
from qrobot.log.arm_view import RATE_HZ
from qrobot.log.header import header_for
from qrobot.log.read import read_log
from qrobot.log.record import write_log
from qrobot.log.scene_bodies import quaternion
from qrobot.log.topics import FRAMES_TOPIC, JOINTS_TOPIC, SCENE_TOPIC, TICK_TOPIC, TOOL_TOPIC, part_path
from qrobot.log.writer import LogWriter
from qrobot.model.arm import Arm
from qrobot.model.arm_shape import link_frames
from qrobot.model.transform import quaternion_into
from tests.support.log_samples import START_NS, make_header, make_rows
from tests.support.protobuf import Schema

PUMA, STANFORD = load_robot("puma560"), load_robot("stanford")
VIEWS = (JOINTS_TOPIC, FRAMES_TOPIC, TOOL_TOPIC)
LAYOUT = Path(__file__).parents[3] / "config/foxglove/arm.json"


def messages(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Log time and data of the messages of each topic."""
    found: dict[str, list[tuple[int, bytes]]] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append((message.log_time, message.data))
    return found


def header_of(robot: Robot, wall_offset_ns: int = 0):
    return replace(header_for(robot, 250_000, "qrobot"), wall_offset_ns=wall_offset_ns)


@pytest.mark.parametrize("robot", [PUMA, STANFORD], ids=lambda robot: robot.name)
@given(shares=st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6))
def test_the_frames_of_the_links_lead_to_where_the_kinematics_say(robot: Robot, shares: list[float]) -> None:
    q = robot.limits.q_min + np.array(shares) * (robot.limits.q_max - robot.limits.q_min)
    np.testing.assert_allclose(np.linalg.multi_dot(link_frames(robot, q.tolist())), Arm(robot).forward(q), atol=1e-12)


@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_the_quaternion_of_a_frame_turns_as_the_frame_does(q: list[float]) -> None:
    for frame in link_frames(PUMA, q):
        turned = np.eye(4)
        quaternion_into(quaternion(frame), turned)
        np.testing.assert_allclose(turned[:3, :3], frame[:3, :3], atol=1e-12)


@pytest.mark.parametrize("block", [4096, 37])
def test_views_come_at_their_rate_whatever_the_blocks_of_rows(tmp_path: Path, block: int) -> None:
    rows = make_rows(4000)  # a second at 4 kHz
    writer = LogWriter(tmp_path / "run.mcap", header_of(PUMA), robot=PUMA)
    for start in range(0, rows.size, block):
        writer.append(rows[start : start + block])
    writer.close()
    found = messages(tmp_path / "run.mcap")
    for topic in VIEWS:
        times = np.array([t for t, _ in found[topic]])
        assert len(times) == RATE_HZ
        assert np.diff(times).tolist() == [1_000_000_000 // RATE_HZ] * (RATE_HZ - 1)
    assert len(found[SCENE_TOPIC]) == 1
    np.testing.assert_array_equal(read_log(tmp_path / "run.mcap").rows, rows)


def test_the_time_of_a_log_is_the_wall_clock_and_rows_keep_the_servos(tmp_path: Path) -> None:
    offset = 1_763_800_000_000_000_000
    write_log(tmp_path / "run.mcap", make_rows(100), header_of(PUMA, offset), robot=PUMA)
    for topic, told in messages(tmp_path / "run.mcap").items():
        assert all(START_NS + offset <= t < START_NS + offset + 10**9 for t, _ in told), topic
    assert read_log(tmp_path / "run.mcap").rows["t_ns"][0] == START_NS


def test_joint_states_name_the_joints_and_every_part_has_its_picture(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "run.mcap", header_of(PUMA), max_bytes=200_000, robot=PUMA)
    rows = make_rows(8000)
    for start in range(0, rows.size, 1000):
        writer.append(rows[start : start + 1000])
        writer.flush()
    writer.close()
    assert len(writer.parts) > 1
    for number in range(1, len(writer.parts) + 1):
        found = messages(part_path(tmp_path / "run.mcap", number))
        if TICK_TOPIC in found:
            assert len(found[SCENE_TOPIC]) == 1
            assert found[JOINTS_TOPIC][0][0] == found[TICK_TOPIC][0][0]
            assert all(name.encode() in found[JOINTS_TOPIC][0][1] for name in PUMA.joint_names)


def test_a_log_without_its_robot_has_no_views(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", make_rows(100), make_header())
    assert not {*VIEWS, SCENE_TOPIC} & messages(tmp_path / "run.mcap").keys()


def test_the_layout_for_foxglove_asks_for_topics_that_there_are(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", make_rows(100), header_of(PUMA), robot=PUMA)
    topics, fields = messages(tmp_path / "run.mcap").keys(), make_rows(1).dtype.names or ()
    layout = json.loads(LAYOUT.read_text())
    panels = layout["configById"]
    assert panels["3D!arm"]["topics"].keys() <= topics
    for panel in panels.values():
        for path in panel.get("paths", ()):
            topic, _, field = path["value"].partition(".")
            assert topic in topics
            assert field.split("[")[0] in fields


TOLD = ToldFences(
    fences=(
        Fence(
            name="table", shape="box", position_m=(0.5, 0.1, -0.3), rpy_deg=(90.0, 0.0, 0.0), size_m=(0.6, 1.0, 0.04)
        ),
        Fence(name="post", shape="cylinder", radius_m=0.1, length_m=1.5),
        Fence(name="cell", shape="plane", keep="in", rpy_deg=(0.0, 90.0, 0.0)),
    ),
    tool=Capsule(name="tool", link=6, from_m=(0.0, 0.0, 0.05), to_m=(0.03, 0.0, 0.09), radius_m=0.02),
)


def pictures(path: Path) -> list[Any]:
    """The scenes of a log, decoded by the schema that stands in the file."""
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=[SCENE_TOPIC], log_time_order=False)
        return [Schema(schema.data).decode(schema.name, message.data) for schema, _, message in messages if schema]


def frame_of(pose: Any) -> np.ndarray:
    T, turn = np.eye(4), pose.orientation
    quaternion_into(np.array([turn.w, turn.x, turn.y, turn.z]), T)
    T[:3, 3] = pose.position.x, pose.position.y, pose.position.z
    return T


def test_fences_tool_and_load_stand_in_the_scene_where_the_deployment_has_them(tmp_path: Path) -> None:
    rows = make_rows(4000)
    rows["payload"][:] = 0.0
    rows["payload"][1000:3000, :4] = 2.0, 0.0, 0.02, 0.2  # kg, and 10 and 100 mm from the last frame
    write_log(tmp_path / "run.mcap", rows, header_of(PUMA), robot=PUMA, fences=TOLD)
    first, loaded, freed = pictures(tmp_path / "run.mcap")
    bodies = {entity.id: entity for entity in first.entities}
    assert {"base", "link_6", "fence table", "fence post", "fence cell", "tool"} <= bodies.keys()
    for name, entity in bodies.items():
        assert entity.frame_locked
        assert entity.frame_id == ("link_6" if name == "tool" else "base" if name.startswith("fence") else name)
    fences = {name: bodies[f"fence {name}"] for name in ("table", "post", "cell")}
    table = fences["table"].cubes[0]
    np.testing.assert_allclose(frame_of(table.pose)[:3, 0], [0.0, 1.0, 0.0], atol=1e-12)  # turned about z
    np.testing.assert_allclose(frame_of(table.pose)[:3, 3], [0.5, 0.1, -0.3])
    assert (table.size.x, table.size.y, table.size.z) == (0.6, 1.0, 0.04)
    post = fences["post"].cylinders[0]
    assert (post.size.x, post.size.y, post.size.z) == (0.2, 0.2, 1.5)
    plate = fences["cell"].cubes[0]
    np.testing.assert_allclose(frame_of(plate.pose)[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)  # the side to stay on
    assert [fence.texts[0].text for fence in fences.values()] == ["table: keep out", "post: keep out", "cell: keep in"]
    rod, ends = bodies["tool"].cylinders[0], bodies["tool"].spheres
    np.testing.assert_allclose(frame_of(rod.pose)[:3, 2], [0.6, 0.0, 0.8], atol=1e-12)
    assert (rod.size.x, rod.size.z) == pytest.approx((0.04, 0.05))
    assert [end.pose.position.x for end in ends] == [0.0, 0.03]
    (ball,) = loaded.entities
    assert (ball.id, ball.frame_id, ball.texts[0].text) == ("payload", "link_6", "2 kg")
    np.testing.assert_allclose(frame_of(ball.spheres[0].pose)[:3, 3], [0.0, 0.01, 0.1])
    assert [gone.id for gone in freed.deletions] == ["payload"]


def test_a_load_is_in_each_part_of_a_log_that_has_it(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "run.mcap", header_of(PUMA), max_bytes=200_000, robot=PUMA)
    rows = make_rows(8000)
    rows["payload"][:, 0] = np.arange(8000) < 7000
    for start in range(0, rows.size, 1000):
        writer.append(rows[start : start + 1000])
        writer.flush()
    writer.close()
    loads = [
        [entity.id for scene in pictures(part) for entity in scene.entities].count("payload") for part in writer.parts
    ]
    gone = [sum(len(scene.deletions) for scene in pictures(part)) for part in writer.parts]
    assert len(loads) > 2
    assert loads[0] == loads[1] == 1
    assert sum(gone) == 1
