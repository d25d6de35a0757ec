# SPDX-License-Identifier: Apache-2.0
"""The files that the suite reads: a good example of each, and what reads it."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import yaml
from ament_index_python.packages import get_package_share_directory

from seed_bringup.bags.files import BagWriter, describe_bag, read_messages
from seed_bringup.launching.description import describe
from seed_bringup.ros.link_frames import joints_of
from seed_control.tasks.load import load_task, shipped_tasks
from seed_core.clocks import read_clocks, save_clocks
from seed_core.config import to_mapping
from seed_core.hand import FINGERS, Hand, read_hand
from seed_core.hysteretic.file import hysteretic_file, load_hysteretic, save_hysteretic
from seed_core.hysteretic.spring import HystereticStiffness
from seed_core.membrane.features import NAMES, SCALES
from seed_core.membrane.map_file import GripMap, MembraneMapFile, format_rows, load_membrane_map, save_membrane_map
from seed_core.stiffness_file import GripStiffness, IdentifiedGrip, StiffnessFile, load_stiffness, save_stiffness
from seed_driver.motion.calibrated_kinematics import KEYS, LINKS, load_calibration
from seed_estimation.calibration import file as camera_calibration
from seed_estimation.calibration.calibrate import read_capture
from seed_estimation.images import identity
from seed_sim.identification.scenario import load as load_identification
from seed_sim.scenario import load_scenario
from seed_sysid.data import sample_file
from seed_sysid.data.bag import bag_lines
from seed_sysid.data.dataset import Header, Sample
from seed_ur.kinematics import URKinematics

DATE = "2026-01-01T00:00:00+00:00"


class Reader(NamedTuple):
    """A kind of file.

    Attributes:
        kind: yaml, lines (of JSON), text or bytes: how it can be spoilt.
        examples: good files.
        read: what reads it.
    """

    name: str
    suffix: str
    kind: str
    examples: tuple[bytes, ...]
    read: Callable[[Path], Any]


def _written(name: str, write: Callable[[Path], object]) -> bytes:
    with TemporaryDirectory() as folder:
        file = Path(folder, name)
        write(file)
        return file.read_bytes()


def _share(package: str, pattern: str) -> tuple[bytes, ...]:
    return tuple(f.read_bytes() for f in sorted(Path(get_package_share_directory(package)).glob(pattern)))


@cache
def READERS() -> tuple[Reader, ...]:
    """All of them."""
    tasks = tuple(f.read_bytes() for f in shipped_tasks().values())
    hand = yaml.safe_dump(to_mapping(Hand())).encode()
    nominal = URKinematics.for_model("ur5e")
    return (
        Reader("task", ".yaml", "yaml", tasks, load_task),
        Reader("scenario", ".yaml", "yaml", _share("seed_sim", "config/scenarios/*.yaml"), load_scenario),
        Reader("identification", ".yaml", "yaml", _share("seed_sim", "config/identify/*.yaml"), _identification),
        Reader("stiffness", ".yaml", "yaml", (_stiffness(),), lambda f: _schedule(load_stiffness(f))),
        Reader("hysteretic", ".yaml", "yaml", (_hysteretic(),), lambda f: load_hysteretic(f).identified),
        Reader("membrane_map", ".yaml", "yaml", (_membrane_map(),), load_membrane_map),
        Reader("camera_calibration", ".yaml", "yaml", (_calibration(),), _offsets),
        Reader("clocks", ".yaml", "yaml", (_clocks(),), lambda f: read_clocks(str(f))),
        Reader("hand", ".yaml", "yaml", (hand, *_share("seed_bringup", "config/hand.yaml")), _hand),
        Reader("arm_calibration", ".yaml", "yaml", (_arm(),), lambda f: load_calibration(str(f), nominal).origins),
        Reader("samples", ".jsonl", "lines", (_samples(),), sample_file.read),
        Reader("launch", ".xml", "text", _launch_files(), _launch),
        Reader("urdf", ".urdf", "text", _share("seed_bringup", "urdf/*.urdf"), joints_of),
        Reader("identity", ".npz", "bytes", (_identity(),), identity.load),
        Reader("capture", ".npz", "bytes", (_capture(),), read_capture),
        Reader("bag", ".mcap", "bytes", (_bag(),), _bag_contents),
    )


def _hand(file: Path) -> Any:
    return read_hand(str(file), alone=True)


def _launch_files() -> tuple[bytes, ...]:
    """Those that include no other."""
    files = _share("seed_bringup", "launch/*.xml") + _share("seed_driver", "launch/*.xml")
    return tuple(f for f in files if b"<include" not in f)


def _launch(file: Path) -> Any:
    return describe(file, {"robot_ip": "127.0.0.2"} if b'"robot_ip"' in file.read_bytes() else {})


def _identification(file: Path) -> Any:
    return load_identification(str(file))


def _schedule(file: StiffnessFile) -> Any:
    grips = GripStiffness(file)
    return file, grips.at_pressure(1015.0), grips.at_width(0.02)


def _offsets(file: Path) -> Any:
    read = camera_calibration.load(file)
    for one in read.fingers.values():
        one.offset_map()
    return read


def _bag_contents(file: Path) -> Any:
    describe_bag(file)
    list(read_messages(file, lambda _: True))
    return bag_lines(file)


def _stiffness() -> bytes:
    grip = IdentifiedGrip(1010.0, 0.026, (4.0, 3.0, 4.0), (800.0, 1200.0, 800.0))
    firm = replace(grip, pressure_hpa=1030.0, width_m=0.014)
    return _written("s.yaml", lambda f: save_stiffness(f, StiffnessFile("hand", "tool", DATE, (grip, firm))))


def _hysteretic() -> bytes:
    spring = HystereticStiffness(
        stiffness=np.array((4.0, 3.0, 4.0, 800.0, 1200.0, 800.0)),
        rise=np.zeros(6),
        yields=np.full((2, 6), 0.01),
        friction=np.full((2, 6), 0.1),
        covariance=np.tile(np.eye(4), (6, 1, 1)),
        residual=np.full(6, 0.01),
        largest=np.full(6, 0.1),
        centre=np.zeros(3),
    )
    made = hysteretic_file(spring, "hand", "tool", DATE, 1030.0, 0.02)
    return _written("h.yaml", lambda f: save_hysteretic(f, made))


def _membrane_map() -> bytes:
    terms = ("roll-", "pitch+", "yaw-", "x+", "y-", "z+", "x+ * y-")
    grip = GripMap(
        pressure_hpa=1030.0,
        width_m=0.02,
        left_middle=(0.0, 0.012, 0.0),
        right_middle=(0.0, -0.012, 0.0),
        torque_std=(0.002,) * 3,
        force_std=(0.1,) * 3,
        coefficients=format_rows(np.eye(6, len(terms))),
        spread=format_rows(0.1 * np.eye(len(terms))),
        pressure_rise=format_rows(np.zeros((2, len(terms)))),
        pressure_std=(0.02, 0.02),
    )
    scales = tuple(SCALES.tolist())
    made = MembraneMapFile("hand", "tool", DATE, scales, terms, (3.0,) * len(NAMES), 2.0, (grip,))
    return _written("m.yaml", lambda f: save_membrane_map(f, made))


def _calibration() -> bytes:
    finger = camera_calibration.FingerCalibration(16, 12, [[0.001] * 4] * 3, Hand().C_L, Hand().C_L)
    other = replace(finger, pose=Hand().C_R, drawn=Hand().C_R)
    made = camera_calibration.Calibration({"left": finger, "right": other}, 0.01, 0.0005)
    return _written("c.yaml", lambda f: camera_calibration.save(made, f))


def _clocks() -> bytes:
    return _written("k.yaml", lambda f: save_clocks(f, 0.012, 0.001, DATE, "arm", "cameras"))


def _arm() -> bytes:
    model = URKinematics.for_model("ur5e").model
    half = np.pi / 2.0
    rows = (
        (0, 0, model.d[0], 0, 0, 0),
        (0, 0, 0, half, 0, 0),
        (model.a[1], 0, 0, 0, 0, 0),
        (model.a[2], 0, model.d[3], 0, 0, 0),
        (0, -model.d[4], 0, half, 0, 0),
        (0, model.d[5], 0, half, np.pi, np.pi),
    )
    links = {link: dict(zip(KEYS, map(float, row), strict=True)) for link, row in zip(LINKS, rows, strict=True)}
    return yaml.safe_dump({"kinematics": links}).encode()


def _samples() -> bytes:
    header = Header(hand="hand", tool="tool")
    pose = (0.001, 0.0, -0.002, 0.01, 0.0, 0.02)
    samples = [Sample(f"p{i}", "home", 0, float(i), pose, (0.1, 0.0, 0.2, 1.0, 2.0, 3.0), pose) for i in range(3)]
    lines = [sample_file.header_line(header), *map(sample_file.sample_line, samples)]
    return ("\n".join(line.rstrip("\n") for line in lines) + "\n").encode()


def _identity() -> bytes:
    rng = np.random.default_rng(0)
    known = {
        f: identity.Known(rng.random((12, 16)).astype(np.float32), f"bubble_{f}_optical", np.eye(3)) for f in FINGERS
    }
    return _written("i.npz", lambda f: identity.save(f, known))


def _capture() -> bytes:
    out, images = BytesIO(), np.full((2, 12, 16), 0.1, np.float32)
    np.savez_compressed(out, left_no_contact=images, left_grasped=images, left_K=np.eye(3), left_D=np.zeros(5))
    return out.getvalue()


def _bag() -> bytes:
    from rclpy.serialization import serialize_message
    from std_msgs.msg import String

    def write(file: Path) -> None:
        with BagWriter(file) as bag:
            topic = bag.add_topic("/identification/samples", "std_msgs/msg/String")
            for number, line in enumerate(_samples().decode().splitlines()):
                bag.write(topic, 1_000_000 * number, serialize_message(String(data=line)))

    return _written("b.mcap", write)
