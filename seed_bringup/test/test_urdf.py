# SPDX-License-Identifier: Apache-2.0
"""The URDF files are those of the script, and their arms are the arms of the kinematics."""

import importlib.util
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from seed_core.errors import SeedError
from seed_core.hand import Hand, Tool
from seed_ur.kinematics import URKinematics
from seed_ur.models import MODELS

FOLDER = Path(__file__).parents[1] / "urdf"
ARMS = ("ur5e", "ur10e")


def chain_pose(file: Path, end: str, start: str, angles: dict[str, float]) -> np.ndarray:
    """Pose of one link in another by walking the URDF's joints (all about z)."""
    joints = {j.find("child").get("link"): j for j in ET.parse(file).getroot().findall("joint")}
    X, link = np.eye(4), end
    while link != start:
        joint = joints[link]
        at = joint.find("origin")
        step = np.eye(4)
        turn = Rotation.from_euler("xyz", [float(t) for t in at.get("rpy").split()])
        step[:3, :3] = (turn * Rotation.from_euler("z", angles.get(joint.get("name"), 0.0))).as_matrix()
        step[:3, 3] = [float(t) for t in at.get("xyz").split()]
        X, link = step @ X, joint.find("parent").get("link")
    return X


@pytest.mark.parametrize("name", ARMS)
def test_committed_file_is_what_the_script_writes(name: str) -> None:
    spec = importlib.util.spec_from_file_location("generate_urdf", FOLDER / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert (FOLDER / f"{name}.urdf").read_text() == module.texts()[f"{name}.urdf"], "run urdf/generate.py"


@pytest.mark.parametrize("name", ARMS)
def test_flange_of_the_urdf_is_the_flange_of_the_dh_table(name: str) -> None:
    arm = URKinematics.for_model(name)
    names = [j.get("name") for j in ET.parse(FOLDER / f"{name}.urdf").getroot().findall("joint[@type='revolute']")]
    for q in np.random.default_rng(8).uniform(-np.pi, np.pi, (20, 6)):
        X = chain_pose(FOLDER / f"{name}.urdf", "tool0", "base", dict(zip(names, q, strict=True)))
        assert_allclose(X, arm.forward(q), atol=1e-8)  # nine decimals in the file


@pytest.mark.parametrize("name", ARMS)
def test_links_lie_where_ur_description_has_those_of_the_same_names(name: str) -> None:
    """Its chain, as ur_macro.xacro and default_kinematics.yaml have it: each joint's place and turn about x."""
    d1, _, _, d4, d5, d6 = MODELS[name].d
    _, a2, a3, *_ = MODELS[name].a
    places = ((0, 0, d1), (0, 0, 0), (a2, 0, 0), (a3, 0, d4), (0, -d5, 0), (0, d6, 0))
    turns = (0.0, np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2)
    q = np.random.default_rng(10).uniform(-np.pi, np.pi, 6)
    names = [j.get("name") for j in ET.parse(FOLDER / f"{name}.urdf").getroot().findall("joint[@type='revolute']")]
    X = np.eye(4)
    for i, link in enumerate(("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")):
        step = np.eye(4)
        step[:3, :3] = Rotation.from_euler("x", turns[i]).as_matrix() @ Rotation.from_euler("z", q[i]).as_matrix()
        step[:3, 3] = places[i]
        X = X @ step
        found = chain_pose(FOLDER / f"{name}.urdf", f"{link}_link", "base", dict(zip(names, q, strict=True)))
        assert_allclose(found, X, atol=1e-8)


@pytest.mark.parametrize("name", ARMS)
def test_compliance_and_tip_are_where_hand_and_tool_say(name: str) -> None:
    file = FOLDER / f"{name}.urdf"
    assert_allclose(chain_pose(file, "compliance", "tool0", {}), Hand().X_EC, atol=1e-8)
    assert_allclose(chain_pose(file, "tip", "tool", {}), Tool().X_Ttip, atol=1e-8)
    assert_allclose(chain_pose(file, "base", "base_link", {})[:3, :3], np.diag([-1.0, -1.0, 1.0]), atol=1e-8)


@pytest.mark.parametrize("name", ARMS)
def test_centre_of_mass_of_the_arm_agrees_with_the_dh_data(name: str) -> None:
    arm, file = URKinematics.for_model(name), FOLDER / f"{name}.urdf"
    q = np.array([0.3, -1.1, 1.4, -0.8, -1.5, 0.4])
    root = ET.parse(file).getroot()
    names = [j.get("name") for j in root.findall("joint[@type='revolute']")]
    for X_dh, com, link, mass in zip(
        arm.frames(q), arm.model.com, [j.find("child").get("link") for j in root.findall("joint[@type='revolute']")],
        arm.model.mass, strict=True,
    ):  # fmt: skip
        inertial = root.find(f"link[@name='{link}']/inertial")
        local = [float(t) for t in inertial.find("origin").get("xyz").split()]
        X = chain_pose(file, link, "base", dict(zip(names, q, strict=True)))
        assert_allclose((X @ [*local, 1])[:3], (X_dh @ [*com, 1])[:3], atol=1e-5)
        assert float(inertial.find("mass").get("value")) == pytest.approx(mass, abs=1e-6)


@pytest.mark.parametrize("name", ARMS)
def test_drake_reads_the_file_and_agrees(name: str) -> None:
    pytest.importorskip("pydrake", reason="drake is not installed")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.001)
    (model,) = Parser(plant).AddModels(str(FOLDER / f"{name}.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q = np.array([0.3, -1.1, 1.4, -0.8, -1.5, 0.4])
    for i, joint in enumerate(("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")):
        plant.GetJointByName(f"{joint}_joint", model).set_angle(context, q[i])
    X = plant.GetFrameByName("tool0").CalcPoseInWorld(context).GetAsMatrix4()
    assert_allclose(X, URKinematics.for_model(name).forward(q), atol=1e-8)


@pytest.mark.parametrize("name", ARMS)
def test_link_frames_form_one_tree_with_those_of_arm_and_hand(name: str) -> None:
    """The last link's frame is the flange of the kinematics, and no frame gets a second parent."""
    pytest.importorskip("rclpy", reason="needs ROS 2")
    pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")
    from seed_bringup.ros.link_frames import OTHERS, joints_of

    joints = joints_of(FOLDER / f"{name}.urdf")
    arm = URKinematics.for_model(name)
    q = np.random.default_rng(9).uniform(-np.pi, np.pi, 6)
    angles = dict(zip([j.name for j in joints if j.moves], q, strict=True))
    parents = {j.child: (j.parent, j.pose(angles.get(j.name, 0.0))) for j in joints}
    assert len(parents) == len(joints)
    assert not set(parents) & set(OTHERS)
    X, link = np.eye(4), "wrist_3_link"
    while link != "base":
        link, step = parents[link]
        X = step @ X
    to_flange = chain_pose(FOLDER / f"{name}.urdf", "tool0", "wrist_3_link", {})
    assert_allclose(X @ to_flange, arm.forward(q), atol=1e-8)


def test_a_file_that_is_no_urdf_is_refused_by_name(tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    pytest.importorskip("tf2_msgs", reason="the workspace is not built (./seed test does it)")
    from seed_bringup.ros.link_frames import joints_of

    file = tmp_path / "arm.urdf"
    for text in ("", "<robot><joint name='a' type='prismatic'><child link='b'/></joint></robot>"):
        file.write_text(text)
        with pytest.raises(SeedError, match=r"arm.urdf cannot be read as a URDF"):
            joints_of(file)
