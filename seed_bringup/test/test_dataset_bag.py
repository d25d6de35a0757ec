# SPDX-License-Identifier: Apache-2.0
"""Datasets for learning: from evaluations and bags to plain arrays, and from those to LeRobot where it is installed."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pydrake", reason="needs Drake")
pytest.importorskip("rclpy", reason="needs ROS 2")

from action_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message
from seed_msgs.msg import ControllerState, RelativePose, WrenchEstimate
from sensor_msgs.msg import Image

from seed_bringup.bags import BagError
from seed_bringup.bags.files import BagWriter
from seed_bringup.dataset.command import REQUIREMENTS, main
from seed_bringup.dataset.environment import interpreter, run
from seed_bringup.dataset.episode import FIELDS, IMAGES, Episode, Frames, write_arrays
from seed_bringup.dataset.episodes_bag import _pixels, check, episodes_of
from seed_bringup.dataset.evaluations import check as check_evaluation
from seed_bringup.dataset.evaluations import evaluated
from seed_bringup.dataset.following import Following
from seed_control.tasks import load_task
from seed_core.errors import FailedError, SeedError
from seed_core.spatial import Wrench, make_pose, rotation_from_rpy, so3_exp
from seed_ros.images.arrays import image_message
from seed_sim.scenario import load_scenario

ROOT = Path(__file__).resolve().parents[2]
FPS, SIZE = 25, (12, 16)
KINDS = {
    "/current_pose": PoseStamped,
    "/relative_pose": RelativePose,
    "/wrench_estimate": WrenchEstimate,
    "/controller/state": ControllerState,
    "/controller/reference": PoseStamped,
    "/bubble_left/ir/image_rect_raw": Image,
    "/bubble_right/ir/image_rect_raw": Image,
}
LIBRARY = interpreter(ROOT / REQUIREMENTS) if (ROOT / REQUIREMENTS).is_file() else None


def write_bag(
    path: Path,
    without: str = "",
    enabled: tuple[float, float] = (0.5, 2.5),
    unseen: tuple[float, float] = (9.0, 9.0),
    encoding: str = "mono16",
    silent: str = "",
    change: Callable[[str, float, Any], None] = lambda *_: None,
) -> None:
    """Three seconds at 50 Hz; the flange rises with 0.1 m/s, image and force tell the step.

    Args:
        path: of the bag.
        without: a topic that is not in it.
        enabled: when a set-point is followed, from and until [s].
        unseen: when relative poses are not valid.
        encoding: of images.
        silent: a topic on which nothing comes from 1.8 s on.
        change: is given topic, time [s] and message before it is written.
    """
    with BagWriter(path) as bag:
        topics = {
            t: bag.add_topic(t, f"{k.__module__.split('.')[0]}/msg/{k.__name__}")
            for t, k in KINDS.items()
            if t != without
        }
        for i in range(150):
            t = i / 50
            for k, (topic, connection) in enumerate(topics.items()):
                if topic == silent and t >= 1.8:
                    continue
                message: Any = KINDS[topic]()
                if topic == "/current_pose":
                    message.pose.position.z = 0.1 * t
                elif topic == "/relative_pose":
                    message.valid = not unseen[0] <= t < unseen[1]
                    message.pose.pose.position.x = 0.001 if message.valid else 0.0
                elif topic == "/wrench_estimate":
                    message.wrench.force.z = -float(i)
                elif topic == "/controller/state":
                    message.enabled, message.setpoint_kind = enabled[0] <= t < enabled[1], "hybrid"
                    message.mode = "contact" if message.enabled else "disabled"
                    message.desired.force.z = -10.0
                elif KINDS[topic] is Image:
                    message.height, message.width, message.encoding, message.step = *SIZE, encoding, 2 * SIZE[1]
                    message.data = np.full(SIZE, 16 * i, "<u2").tobytes()
                change(topic, t, message)
                after = 20_000 * k  # [ns]: one comes after another
                bag.write(connection, round(1e9 * (100.0 + t)) + after, serialize_message(message))


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8"])
def test_colour_images_become_rgb(encoding: str) -> None:
    colours = dict(zip("rgba", (100, 50, 10, 77), strict=True))
    pixel = [colours[c] for c in encoding[:-1]]
    image = image_message(np.full((2, 3, len(pixel)), pixel, dtype=np.uint8), encoding, 0.0, "cam")
    np.testing.assert_array_equal(_pixels(image), np.full((2, 3, 3), (100, 50, 10)))


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(
    ("encoding", "kind", "value", "shown"),
    [
        ("mono8", "u1", 100, 100),
        ("8UC1", "u1", 100, 100),
        ("mono16", "u2", 1600, 100),  # of 12 bits
        ("16UC1", "u2", 1600, 100),
        ("32FC1", "f4", 1600.0, 100),
    ],
)
def test_infrared_images_become_grey(order: str, encoding: str, kind: str, value: float, shown: int) -> None:
    image = image_message(np.full((2, 3), value, order + kind), encoding, 0.0, "cam")
    image.is_bigendian = int(order == ">")
    np.testing.assert_array_equal(_pixels(image), np.full((2, 3, 3), shown))


def test_images_of_an_unknown_encoding_are_told_when_a_bag_is_checked(tmp_path: Path) -> None:
    write_bag(tmp_path / "good", encoding="16UC1")
    check(tmp_path / "good")
    write_bag(tmp_path / "bayer", encoding="bayer_rggb16")
    with pytest.raises(BagError, match=r"/bubble_.*: images: encoding 'bayer_rggb16' is none of mono16, 16UC1, mono8"):
        check(tmp_path / "bayer")


def test_an_evaluation_becomes_an_episode() -> None:
    episode = evaluated(load_task("squeegee"), 1, FPS, "truth")
    assert len(episode) == pytest.approx(25 * 9, abs=50)  # some 9 s
    assert set(episode.fields) == set(FIELDS)
    assert episode.task.startswith("press a blade onto a table")
    np.testing.assert_allclose(np.diff(episode.timestamps), 1.0 / FPS)
    force = episode.fields["observation.wrench"][:, FIELDS["observation.wrench"].index("force_z")]
    wanted = episode.fields["action"][:, FIELDS["action"].index("force_z")]
    pressing = np.flatnonzero(wanted == -10.0)  # [N]: of the tool on the table, whose z points up
    assert np.median(force[pressing[len(pressing) // 2 :]]) == pytest.approx(-10.0, abs=0.3)
    state = episode.fields["observation.state"]
    assert state[:, 0].max() - state[:, 0].min() == pytest.approx(0.265, abs=0.015)  # [m] of the flange along the wipe
    for first in (3, 10):  # no quaternion jumps to its negative
        assert np.abs(np.diff(state[:, first : first + 4], axis=0)).max() < 0.1


def test_the_flange_of_an_evaluation_is_the_one_that_the_controller_was_told(monkeypatch: pytest.MonkeyPatch) -> None:
    nominal = load_scenario("nominal")
    noisy = replace(nominal, measurement=replace(nominal.measurement, kinematics_noise=0.3))  # [mm]
    monkeypatch.setattr("seed_bringup.dataset.evaluations.load_scenario", lambda _: noisy)
    task = load_task("squeegee")
    down = replace(task.phases[0], to=(0.0, 0.0, 0.02))
    episode = evaluated(replace(task, phases=(down, *task.phases[3:])), 1, FPS, "truth", text="approach and lift")
    assert np.std(episode.fields["observation.state"][:, 1]) == pytest.approx(0.3e-3, rel=0.25)  # [m], nothing moves it


def test_images_are_kept_where_the_estimator_works_on_them() -> None:
    task = load_task("squeegee")
    first = replace(task.phases[0], to=(0.0, 0.0, 0.05))
    episode = evaluated(
        replace(task, phases=(first, *task.phases[1:2], *task.phases[3:])), 1, 10, text="press and lift"
    )
    n = len(episode)
    assert episode.task == "press and lift"
    for name in IMAGES.values():
        pictures = episode.fields[name]
        assert (pictures.shape, pictures.dtype) == ((n, 171, 224, 3), np.uint8)
        assert pictures[0].std() > 5.0  # dots are seen
        assert np.abs(pictures[::5].astype(float) - pictures[0]).max() > 20.0  # and move with the tool


def test_a_bag_becomes_an_episode_of_each_stretch_with_a_set_point(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag")
    (episode,) = episodes_of(tmp_path / "bag", FPS, "wipe the table")
    assert len(episode) == pytest.approx(2.0 * FPS, abs=2)
    rises = np.diff(episode.fields["observation.state"][:, 2])
    assert rises.sum() == pytest.approx(0.1 * len(rises) / FPS, abs=0.004)  # [m] with 0.1 m/s
    assert (episode.fields["action"][:, FIELDS["action"].index("force_z")] == -10.0).all()
    counts = episode.fields["observation.images.right"][:, 0, 0, 0]
    newest = -episode.fields["observation.wrench"][:, 2]
    assert np.abs(counts - newest).max() <= 1.0  # image and wrench of one moment
    assert episode.fields["observation.images.right"].shape[1:] == (*SIZE, 3)


@pytest.mark.parametrize(("until", "frames"), [(1.1, [50]), (1.4, [27, 27])])
def test_poses_that_are_not_valid_are_no_data_and_a_stretch_without_any_ends_the_episode(
    tmp_path: Path, until: float, frames: list[int]
) -> None:
    enabled = (0.0, 2.5) if len(frames) > 1 else (0.5, 2.5)
    write_bag(tmp_path / "bag", enabled=enabled, unseen=(1.0, until))
    episodes = list(episodes_of(tmp_path / "bag", FPS, "wipe the table"))
    assert [len(e) for e in episodes] == pytest.approx(frames, abs=4)
    for e in episodes:
        np.testing.assert_allclose(e.fields["observation.state"][:, 7], 0.001)  # x of the grasp, never that of none


def test_an_episode_begins_with_its_own_set_point(tmp_path: Path) -> None:
    def change(topic: str, t: float, message: Any) -> None:
        if topic == "/controller/state":  # two tasks; between them nothing is followed, and no reference published
            message.enabled = t < 1.1 or t >= 1.2
        if topic == "/controller/reference":
            message.pose.position.x = 1.0 if t < 1.2 else 2.0

    write_bag(tmp_path / "bag", enabled=(0.0, 9.0), change=change)
    for episode, x in zip(episodes_of(tmp_path / "bag", FPS, "wipe"), (1.0, 2.0), strict=True):
        np.testing.assert_array_equal(episode.fields["action"][:, 0], x)


def test_a_hold_ends_the_episode(tmp_path: Path) -> None:
    def change(topic: str, t: float, message: Any) -> None:
        if topic == "/controller/state" and t >= 1.6:
            message.mode = "holding"  # enabled, and the set-point is kept

    write_bag(tmp_path / "bag", enabled=(0.0, 9.0), change=change)
    (episode,) = episodes_of(tmp_path / "bag", FPS, "wipe")
    assert len(episode) == pytest.approx(1.6 * FPS, abs=2)


def told(mode: str, force: float = 0.0) -> ControllerState:
    message = ControllerState(enabled=True, setpoint_kind="hybrid", mode=mode)
    message.desired.force.z = force
    return message


def reference(x: float) -> PoseStamped:
    message = PoseStamped()
    message.pose.position.x = x
    return message


def followed(task: tuple[float, float] | None, pressed: bool = False) -> float:
    """Until when [s] a set-point is followed that moves from 1 to 2 s and then stands; task: when one is played."""
    following, last = Following(), 0.0
    for i in range(400):
        t = i / 50
        following.take("controller/state", told("contact" if pressed else "position"), t)
        following.take("controller/reference", reference(0.1 * min(max(t - 1.0, 0.0), 1.0)), t)
        if task is not None and t in task:
            status = GoalStatus.STATUS_EXECUTING if t == task[0] else GoalStatus.STATUS_SUCCEEDED
            following.take("the task", GoalStatusArray(status_list=[GoalStatus(status=status)]), t)
        assert pressed or t >= 1.0 or not following.at(t)  # what stands when the bag begins
        last = t if following.at(t) else last
    return last


def test_a_set_point_that_stands_in_the_air_is_followed_for_a_second_and_a_dwell_of_a_task_to_its_end() -> None:
    assert followed(None) == pytest.approx(3.0, abs=0.03)
    assert followed(None, pressed=True) == pytest.approx(8.0, abs=0.03)
    assert followed((0.5, 6.0)) == pytest.approx(6.0, abs=0.03)  # a dwell of 4 s
    assert followed((0.5, 2.0)) == pytest.approx(2.0, abs=0.03)  # the task has ended, and the set-point is kept
    assert followed((0.5, 6.0), pressed=True) == pytest.approx(6.0, abs=0.03)


@pytest.mark.parametrize("silent", [k for k in KINDS if k != "/relative_pose"])
def test_a_stream_that_stops_ends_the_episode(tmp_path: Path, silent: str) -> None:
    write_bag(tmp_path / "bag", silent=silent)
    (episode,) = episodes_of(tmp_path / "bag", FPS, "wipe the table")
    patience = 0.3 if "bubble" in silent else 0.2  # [s]
    assert len(episode) == pytest.approx((1.8 + patience - 0.5) * FPS, abs=2)


@pytest.mark.parametrize(("topic", "says"), [("wrench_estimate", "not finite"), ("current_pose", "norm 0")])
def test_what_is_no_number_is_not_measured(tmp_path: Path, topic: str, says: str) -> None:
    def change(at: str, t: float, message: Any) -> None:
        if at == "/wrench_estimate" == f"/{topic}" and 1.5 <= t < until:
            message.wrench.force.z = np.nan
        if at == "/current_pose" == f"/{topic}" and 1.5 <= t < until:
            message.pose.orientation.w = 0.0

    for until, frames in ((1.6, [75]), (1.9, [42, 28])):  # for 0.1 s what came last serves
        said: list[str] = []
        bag = tmp_path / f"bag_{until}"
        write_bag(bag, enabled=(0.0, 9.0), change=change)
        assert [len(e) for e in episodes_of(bag, FPS, "wipe", tell=said.append)] == pytest.approx(frames, abs=2)
        (line,) = said
        assert line.startswith(f"{bag}, 1.5 s into it: /{topic}: left out")
        assert says in line


@pytest.mark.parametrize(("since", "frames"), [(1.5, [37]), (0.4, [10, 65])])
def test_pictures_of_another_size_end_the_episode_and_are_left_out(
    tmp_path: Path, since: float, frames: list[int]
) -> None:
    def change(topic: str, t: float, message: Any) -> None:
        if KINDS[topic] is Image and t >= since:
            message.height, message.width, message.step = 6, 8, 16
            message.data = np.full((6, 8), 160, "<u2").tobytes()

    said: list[str] = []
    write_bag(tmp_path / "bag", enabled=(0.0, 9.0), change=change)
    (episode,) = episodes_of(tmp_path / "bag", FPS, "wipe", tell=said.append)  # the first that is long enough stays
    assert len(episode) == pytest.approx(frames[-1], abs=2)
    assert f"bag, {since} s into it: /bubble_left/ir/image_rect_raw: 8 x 6 pixels, 16 x 12 before" in said[0]
    assert ["are left out: pictures of another size" in line for line in said[2:]] == [True] * (since > 1.0)


def test_a_picture_that_cannot_be_read_is_told_with_its_place(tmp_path: Path) -> None:
    def change(topic: str, t: float, message: Any) -> None:
        if KINDS[topic] is Image and t >= 1.5:
            message.encoding = "bayer_rggb16"

    write_bag(tmp_path / "bag", change=change)
    with pytest.raises(BagError, match=r"bag, 1\.5 s into it: .*'bayer_rggb16' is none of"):
        list(episodes_of(tmp_path / "bag", FPS, "wipe"))


def test_a_stream_that_never_lasts_is_named(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", enabled=(1.7, 2.9), silent="/wrench_estimate")
    with pytest.raises(BagError, match="for 1 s in which wrench_estimate went on: nothing to learn"):
        next(episodes_of(tmp_path / "bag", FPS, ""))


def test_episodes_are_made_one_after_the_other(tmp_path: Path) -> None:
    def episodes() -> Iterator[Episode]:
        yield small()
        assert (tmp_path / "arrays/episode_000.npz").is_file()
        yield small()

    assert len(write_arrays(episodes(), tmp_path / "arrays")["episodes"]) == 2


def test_bags_that_cannot_be_used_say_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_bag(tmp_path / "lacks", without="/controller/reference")
    with pytest.raises(BagError, match="lacks /controller/reference: record with"):
        next(episodes_of(tmp_path / "lacks", FPS, ""))
    write_bag(tmp_path / "short", enabled=(0.5, 0.9))
    with pytest.raises(BagError, match="no set-point was followed for 1 s"):
        next(episodes_of(tmp_path / "short", FPS, ""))
    with pytest.raises(BagError, match="not a readable bag"):
        next(episodes_of(tmp_path / "none", FPS, ""))
    write_bag(tmp_path / "old")
    name = "seed_bringup.bags.types.InstalledTypes.hash"
    monkeypatch.setattr(name, lambda *_: "RIHS01_of_a_later_version")  # as after an update of the suite
    with pytest.raises(BagError, match="was recorded with another version of"):
        next(episodes_of(tmp_path / "old", FPS, ""))


def small(task: str = "press", frames: int = 4, size: tuple[int, int] = SIZE) -> Episode:
    X, rows = make_pose(rotation_from_rpy(np.array((0.1, 0.2, 0.3))), (0.4, 0.5, 0.6)), Frames()
    for i in range(frames):
        picture = np.full((*size, 3), 10 * i, np.uint8)
        load = Wrench(np.array((0.1, 0.2, 0.3)), np.array((1.0, 2.0, -10.0 - i)))
        rows.add(X, X, load, X, load, {"left": picture, "right": picture})
    return rows.episode(task, FPS)


def test_plain_arrays_hold_names_shapes_and_rate(tmp_path: Path) -> None:
    write_arrays([small(), small("wipe", 6)], tmp_path / "arrays")
    info = json.loads((tmp_path / "arrays/info.json").read_text())
    assert info["fps"] == FPS
    assert info["episodes"] == [{"task": "press", "frames": 4}, {"task": "wipe", "frames": 6}]
    for name, names in FIELDS.items():
        assert info["fields"][name] == {"shape": [len(names)], "names": list(names)}
        assert len(set(names)) == len(names)
    with np.load(tmp_path / "arrays/episode_001.npz") as data:
        np.testing.assert_allclose(data["timestamp"], np.arange(6) / FPS)
        np.testing.assert_allclose(data["observation.wrench"][5], (1.0, 2.0, -15.0, 0.1, 0.2, 0.3))
    with pytest.raises(SeedError, match="differ in fields"):
        write_arrays([small(), small(size=(6, 8))], tmp_path / "mixed")
    with pytest.raises(SeedError, match="needs 2 at 25"):
        small(frames=1)


def test_orientations_of_a_tool_that_points_down_have_one_sign_in_all_episodes() -> None:
    rng, down, load = np.random.default_rng(2), rotation_from_rpy(np.array((np.pi, 0.0, 0.0))), Wrench.zero()
    for _ in range(20):
        rows = Frames()
        for _ in range(3):  # with noise of half a degree, which has w of either sign
            flange, tip = (make_pose(down @ so3_exp(0.01 * rng.standard_normal(3)), (0.4, 0.0, 0.1)) for _ in range(2))
            rows.add(flange, np.eye(4), load, tip, load, {})
        fields = rows.episode("press", FPS).fields
        for name, first in (("observation.state", 3), ("action", 3)):
            np.testing.assert_allclose(fields[name][:, first : first + 4], [(1.0, 0.0, 0.0, 0.0)] * 3, atol=0.03)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("there", "--evaluate", "squeegee", "--arrays"), "there exists already: name another folder"),
        (("new",), "name bags, or a task with --evaluate"),
        (("new", "bag"), "say with --text in words"),
        (("new", "--evaluate", "squeegee", "--fps", "30"), "--fps 30 must divide"),
        (("new", "--evaluate", "squeege"), "squeege"),
        (("new", "nothing.mcap", "--text", "wipe"), "not a readable bag"),
    ],
)
def test_mistakes_are_told_before_anything_is_made(
    words: tuple[str, ...],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("seed_bringup.dataset.command.make", lambda _: pytest.fail("gigabytes are fetched"))
    (tmp_path / "there").mkdir()
    assert main(list(words)) == 2
    assert says in capsys.readouterr().err
    assert [f.name for f in tmp_path.iterdir()] == ["there"]


ENDED = """
import sys, time
from seed_bringup.dataset import command
def episodes(options, check):
    print("begun", flush=True)
    while True:
        check()
        time.sleep(0.01)
command._episodes = episodes
sys.exit(command.main(["made", "--evaluate", "squeegee", "--arrays"]))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda n: n.name)
def test_a_dataset_that_is_ended_leaves_nothing(tmp_path: Path, number: int) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", ENDED], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    assert [p.name.startswith(".made-") for p in tmp_path.iterdir()] == [True]
    process.send_signal(number)
    assert "interrupted" in process.communicate(timeout=60.0)[1]
    assert process.returncode == 130
    assert not list(tmp_path.iterdir())


def stop() -> None:
    raise KeyboardInterrupt


def test_it_is_ended_within_a_bag_an_evaluation_and_the_writer(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag")
    with pytest.raises(KeyboardInterrupt):
        next(episodes_of(tmp_path / "bag", FPS, "wipe", checked=stop))
    with pytest.raises(KeyboardInterrupt):
        evaluated(load_task("squeegee"), 1, FPS, "truth", checked=stop)
    (tmp_path / "sleep.py").write_text("import time\ntime.sleep(600)\n")
    with pytest.raises(KeyboardInterrupt):
        run(Path(sys.executable), tmp_path / "sleep.py", check=stop)
    (tmp_path / "fails.py").write_text("raise SystemExit('the disk is full')\n")
    with pytest.raises(FailedError, match="the disk is full"):
        run(Path(sys.executable), tmp_path / "fails.py")


def test_an_estimator_that_cannot_work_is_told_before_anything_is_fetched(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["new", "--evaluate", "squeegee", "--estimator", "gel"])
    assert "invalid choice: 'gel'" in capsys.readouterr().err
    with pytest.raises(SeedError, match="scenario nominal has no gels"):
        check_evaluation(load_task("squeegee"), FPS, "gel")


READ = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
d = LeRobotDataset("seed/test", root=sys.argv[1])
x = d[5]
print(json.dumps({"frames": len(d), "episodes": d.num_episodes, "fps": d.fps, "task": x["task"],
    "timestamp": float(x["timestamp"]), "wrench": x["observation.wrench"].tolist(), "action": len(x["action"]),
    "image": list(x["observation.images.left"].shape), "names": d.meta.features["action"]["names"]}))
"""


@pytest.mark.skipif(LIBRARY is None, reason="LeRobot's environment is not made: ./seed dataset makes it")
def test_the_real_library_reads_the_dataset_back(tmp_path: Path) -> None:
    assert LIBRARY is not None
    write_arrays([small(), small("wipe", 6)], tmp_path / "arrays")
    script = ROOT / "seed_bringup/seed_bringup/dataset/lerobot_writer.py"
    run(LIBRARY, script, str(tmp_path / "arrays"), str(tmp_path / "made"), "seed/test")
    outside = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
    command = [str(LIBRARY), "-c", READ, str(tmp_path / "made")]
    done = subprocess.run(command, env={**outside, "HF_HUB_OFFLINE": "1"}, capture_output=True, text=True, timeout=90)
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout.splitlines()[-1])
    assert (read["frames"], read["episodes"], read["fps"], read["task"]) == (10, 2, FPS, "wipe")
    assert read["timestamp"] == pytest.approx(1 / FPS)  # the second frame of the second episode
    np.testing.assert_allclose(read["wrench"], (1.0, 2.0, -11.0, 0.1, 0.2, 0.3), rtol=1e-6)
    assert read["image"] == [3, *SIZE]
    assert read["names"] == list(FIELDS["action"])
