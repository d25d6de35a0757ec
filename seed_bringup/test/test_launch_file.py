# SPDX-License-Identifier: Apache-2.0
"""Launch files: all that they may say, and the refusals of everything else."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from seed_bringup.commands.launch import checked_arguments
from seed_bringup.launching.contradictions import contradictions
from seed_bringup.launching.description import TERM_AFTER, Description, declared_arguments, describe
from seed_bringup.launching.launch_xml import LaunchError
from seed_bringup.launching.substitution import SubstitutionError, evaluate, substitute
from seed_control.parameters import ControllerParameters
from seed_core.errors import SeedError
from seed_core.hand import read_hand
from seed_driver.config import DriverConfig
from seed_driver.motion.servo_motion import COMMANDED
from seed_driver.target_guard import GuardConfig
from seed_sim.hand_file import beliefs, compare, hand_file_of
from seed_sim.scenario import load_scenario, shipped_scenarios

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An install prefix with a package `cell` and its executable `sleeper`."""
    (tmp_path / "share/ament_index/resource_index/packages").mkdir(parents=True)
    (tmp_path / "share/ament_index/resource_index/packages/cell").touch()
    (tmp_path / "share/cell/launch").mkdir(parents=True)
    program = tmp_path / "lib/cell/sleeper"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\nexec sleep 60\n")
    program.chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    return tmp_path


def resolve(folder: Path, body: str, **arguments: str) -> Description:
    file = folder / "under_test_launch.xml"
    file.write_text(f"<launch>\n{body}\n</launch>\n")
    return describe(file, arguments)


def test_node_collects_parameters_remaps_environment_and_namespace(prefix: Path) -> None:
    (prefix / "p.yaml").write_text("/**:\n  ros__parameters: {}\n")
    (node,) = resolve(
        prefix,
        f"""<push_ros_namespace namespace="left"/>
        <node pkg="cell" exec="sleeper" name="control" namespace="arm" args="-a b" on_exit="shutdown">
          <param name="rate" value="250.0"/> <param name="n" value="5" type="str"/> <param name="on" value="true"/>
          <param name="gains" value="1,2" value-sep=","/> <param name="a"><param name="b" value="x"/></param>
          <param from="{prefix}/p.yaml"/> <remap from="pose" to="current_pose"/> <env name="MODE" value="fast"/>
        </node>""",
    ).nodes
    assert node.parameters == (
        {"rate": 250.0},
        {"n": "5"},
        {"on": True},
        {"gains": [1, 2]},
        {"a": {"b": "x"}},
        prefix / "p.yaml",
    )
    assert (node.namespace, node.name, node.arguments) == ("/left/arm", "control", ("-a", "b"))
    assert node.remappings == (("pose", "current_pose"),)
    assert node.environment["MODE"] == "fast"
    assert node.shutdown_on_exit


def test_arguments_have_defaults_and_conditions_follow_them(prefix: Path) -> None:
    body = """<arg name="sim" default="true"/>
    <arg name="law" default="seed"><choice value="seed"/><choice value="welded"/></arg>
    <node pkg="cell" exec="sleeper" name="plant" if="$(var sim)"/>
    <node pkg="cell" exec="sleeper" name="driver" unless="$(var sim)"/>
    <node pkg="cell" exec="sleeper" name="baseline" if="$(eval '\\'$(var law)\\' == \\'welded\\'')"/>"""
    assert [n.name for n in resolve(prefix, body).nodes] == ["plant"]
    assert [n.name for n in resolve(prefix, body, sim="False", law="welded").nodes] == ["driver", "baseline"]


def test_group_keeps_its_settings_and_include_shares_them(prefix: Path) -> None:
    (prefix / "inner.xml").write_text(
        '<launch><arg name="who" default="nobody"/><node pkg="cell" exec="sleeper" name="$(var who)"/>'
        '<let name="set_inside" value="yes"/></launch>'
    )
    names = [
        n.namespace + ":" + n.name
        for n in resolve(
            prefix,
            """<group><push_ros_namespace namespace="a"/><let name="x" value="1"/>
            <include file="$(dirname)/inner.xml"><arg name="who" value="left"/></include></group>
            <include file="$(dirname)/inner.xml"/>
            <node pkg="cell" exec="sleeper" name="is_$(var set_inside)"/>""",
        ).nodes
    ]
    assert names == ["/a:left", ":nobody", ":is_yes"]
    with pytest.raises(LaunchError, match=r"under_test_launch.xml:3: name: \$\(var x\): no <arg> or <let>"):
        resolve(
            prefix,
            '<group><let name="x" value="1"/></group>\n<node pkg="cell" exec="sleeper" name="$(var x)"/>',
        )


def test_dirname_is_refused_where_ros2_would_take_it_for_another_folder(prefix: Path) -> None:
    """ROS 2 Jazzy does not go back to the file's own folder after an include (ros2/launch issue 618)."""
    (prefix / "parts").mkdir()
    (prefix / "parts/part.xml").write_text("<launch/>")
    include = '<include file="$(dirname)/parts/part.xml"/>\n'
    resolve(prefix, include)
    with pytest.raises(
        LaunchError, match=r"under_test_launch.xml:3: \$\(dirname\) after an <include> is the folder of"
    ):
        resolve(prefix, include + '<let name="x" value="$(dirname)"/>')
    resolve(prefix, include + '<let name="x" value="$(dirname)" if="false"/>')


def test_a_variable_gives_all_nodes_their_time_to_end(prefix: Path) -> None:
    """As `ros2 launch` has it; its nodes take no substitution for an attribute."""
    nodes = '<node pkg="cell" exec="sleeper"/><node pkg="cell" exec="sleeper" sigterm_timeout="0.5"/>'
    given = resolve(prefix, '<let name="sigterm_timeout" value="120.0"/>' + nodes).nodes
    assert [n.sigterm_timeout for n in given] == [120.0, 0.5]
    assert [n.sigterm_timeout for n in resolve(prefix, nodes).nodes] == [TERM_AFTER, 0.5]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<nodes pkg="cell"/>', r":2: <nodes> is not known inside <launch>; allowed: .*<node>"),
        (
            '\n<node pkg="cell" exec="sleeper" nmae="x"/>',
            r":3: <node> has no attribute 'nmae'; it takes: .*name",
        ),
        ('<node pkg="cell"/>', r":2: <node> lacks the attribute 'exec'"),
        (
            '<node pkg="cell" exec="sleepy"/>',
            r":2: package 'cell' has no executable 'sleepy'; it has: sleeper",
        ),
        ('<node pkg="cel" exec="sleeper"/>', r":2: package 'cel' is not installed"),
        ('<node pkg="cell" exec="sleeper" on_exit="restart"/>', r":2: on_exit='restart' must be 'shutdown'"),
        ('<node pkg="cell" exec="sleeper" if="maybe"/>', r":2: if='maybe' must be true, false, 1 or 0"),
        (
            '<node pkg="cell" exec="sleeper"><param name="a" value="b" type="int"/></node>',
            r":2: value='b' is no int",
        ),
        (
            '<node pkg="cell" exec="sleeper"><param from="/no/where.yaml"/></node>',
            r":2: from='/no/where.yaml': no such",
        ),
        (
            '<node pkg="cell" exec="sleeper" sigterm_timeout="$(env HOME)"/>',
            r":2: sigterm_timeout='\$\(env HOME\)' must be a number from 0 on, without \$\(...\)",
        ),
        ('<node pkg="cell" exec="sleeper" respawn_delay="-1"/>', r":2: respawn_delay='-1' must be a number from 0 on"),
        (
            '<let name="sigterm_timeout" value="long"/><node pkg="cell" exec="sleeper"/>',
            r":2: sigterm_timeout:='long' must be a number",
        ),
        ('<include file="gone.xml"/>', r":2: file='gone.xml': no such launch file"),
        (
            '<include file="x"><arg name="a" default="b"/></include>',
            r":2: <arg> inside <include> takes name and value",
        ),
        ('<arg name="must"/>', r":2: launch argument 'must' has no default; give must:=VALUE"),
        ('<arg name="a" default="x"><choice value="y"/></arg>', r":2: a:='x' must be one of: y"),
        ('<let name="x" value="$(env SEED_NO_SUCH)"/>', r":2: value: .*SEED_NO_SUCH is not set"),
        ('<let name="x" value="$(command ls)"/>', r":2: value: \$\(command ls\) is not known"),
        ('<let name="x" value="$(var"/>', r":2: value: .*not closed"),
        ("stray", r":1: text 'stray' between tags"),
        ('<let name="x" value="1">', r":3: not XML: mismatched tag"),
        (
            "<include file='$(dirname)/under_test_launch.xml'/>",
            r":2: more than 20 launch files include each other",
        ),
    ],
)
def test_mistakes_are_refused_with_file_and_line(prefix: Path, body: str, message: str) -> None:
    with pytest.raises(LaunchError, match=r"under_test_launch\.xml" + message):
        resolve(prefix, body)


def test_unknown_argument_names_what_there_is(prefix: Path) -> None:
    with pytest.raises(LaunchError, match=r"no launch argument 'forse'. It takes: force, speed; did you mean force\\?"):
        resolve(prefix, '<arg name="force" default="5"/><arg name="speed" default="1"/>', forse="3")


def test_document_types_are_refused(prefix: Path) -> None:
    file = prefix / "bomb.xml"
    file.write_text('<!DOCTYPE l [<!ENTITY a "aaaa">]>\n<launch/>')
    with pytest.raises(LaunchError, match="document type"):
        describe(file, {})


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 + 2 * 3", 7),
        ("'a' == 'a' and not 2 > 3", True),
        ("1 < 2 < 3", True),
        ("'x' in ['x', 'y']", True),
        ("-2.5 / 5", -0.5),
    ],
)
def test_eval_computes_comparisons_and_arithmetic(expression: str, value: object) -> None:
    assert evaluate(expression) == value


@pytest.mark.parametrize(
    "expression", ["__import__('os')", "(1).__class__", "[x for x in 'a']", "9 ** 99", "seed == 1", "1 <"]
)
def test_eval_refuses_everything_else(expression: str) -> None:
    with pytest.raises(SubstitutionError):
        evaluate(expression)


def test_substitutions_nest_and_quote() -> None:
    text = "$(env MISSING $(var a)) $(var $(var b)) $(eval \"'$(var a)' == 'one'\") $5"
    assert substitute(text, {"a": "one", "b": "a"}, {}, Path("f")) == "one one True $5"


def test_missing_and_declared_arguments_are_listed_without_running(prefix: Path) -> None:
    file = prefix / "listed.xml"
    (prefix / "inner.xml").write_text('<launch><arg name="given"/><arg name="open" default="2"/></launch>')
    file.write_text(
        '<launch><arg name="must" description="needed"/><include file="$(dirname)/inner.xml">'
        '<arg name="given" value="1"/></include></launch>'
    )
    listed = {a.name: (a.default, a.description) for a in declared_arguments(file)}
    assert listed == {"must": (None, "needed"), "open": ("2", "")}


@pytest.mark.parametrize("file", sorted(ROOT.glob("seed_*/launch/*.xml")), ids=lambda f: f.name)
def test_every_launch_file_of_the_suite_resolves(file: Path) -> None:
    needed = {a.name: "1" for a in declared_arguments(file) if a.default is None}
    assert describe(file, needed).nodes


def test_a_driver_without_a_robot_is_refused_before_it_starts() -> None:
    """It would stay unconfigured, and look as if it ran."""
    file = ROOT / "seed_driver/launch/driver_launch.xml"
    with pytest.raises(LaunchError, match="'robot_ip' has no default; give robot_ip:=VALUE"):
        describe(file, {})
    assert {"robot_ip": "127.0.0.2"} in describe(file, {"robot_ip": "127.0.0.2"}).nodes[0].parameters


def test_the_demo_runs_the_same_file_with_the_real_driver_in_the_loop() -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    from seed_bringup.demo.plan import robot_arguments

    def programs(words: list[str]) -> set[str]:
        arguments = {**robot_arguments(words), "method": "truth"}
        return {n.name for n in describe(ROOT / "seed_bringup/launch/demo_launch.xml", arguments).nodes}

    assert programs(["robot:=sim"]) == {"controller", "sim", "page"}
    assert programs(["robot:=ur", "robot_ip:=127.0.0.2"]) == {"controller", "sim", "driver", "ur_controller", "page"}
    assert programs(["robot_ip:=127.0.0.7"]) == programs(["robot:=ur"])
    for elsewhere in ("192.168.56.101", "127.example.com", "127.0.0.2.example.com", "localhost"):
        with pytest.raises(SeedError, match="the demo runs in simulation"):
            robot_arguments(["robot:=ur", f"robot_ip:={elsewhere}"])
    with pytest.raises(SeedError, match="the demo takes"):
        robot_arguments(["robt:=ur"])


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"robot": "sim"}, "simulated"),
        ({"robot": "ur", "robot_ip": "127.0.0.2"}, "simulated"),
        ({"robot": "ur", "robot_ip": "192.168.56.101"}, ""),
        ({"robot": "ur", "robot_ip": "192.168.56.101", "clocks": "one"}, "one"),
    ],
)
def test_estimator_and_controller_of_a_real_arm_know_of_clocks_what_the_user_says(
    arguments: dict[str, str], told: str
) -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    nodes = describe(ROOT / "seed_bringup/launch/cell_launch.xml", arguments).nodes
    given = [(n.name, p["clocks"]) for n in nodes for p in n.parameters if isinstance(p, dict) and "clocks" in p]
    assert sorted(given) == [("controller", told), ("estimator", told)]


def test_a_namespace_is_every_nodes_once() -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    for arguments in ({"robot": "sim"}, {"robot": "ur", "robot_ip": "127.0.0.2"}):
        nodes = describe(ROOT / "seed_bringup/launch/cell_launch.xml", {**arguments, "namespace": "left"}).nodes
        assert {n.namespace for n in nodes} == {"/left"}
        apart = {("/tf", "tf"), ("/tf_static", "tf_static"), ("/clock", "clock")}
        assert all(apart <= {*n.remappings} for n in nodes if n.name != "ur_controller")


def test_an_arm_of_ones_own_has_the_guard_in_front_and_the_controller_listens_to_both() -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    arguments = {"arm_target": "/mine/go", "arm_pose": "/mine/is", "base": "panda_link0"}
    nodes = {n.name: n for n in describe(ROOT / "seed_bringup/launch/own_arm_launch.xml", arguments).nodes}
    assert set(nodes) == {"controller", "estimator", "guard"}
    controller, guard = nodes["controller"], nodes["guard"]
    assert {("current_pose", "/mine/is"), ("arm_hold_reason", "guard/hold_reason")} <= {*controller.remappings}
    assert {("current_pose", "/mine/is"), ("guarded_frame", "/mine/go")} <= {*guard.remappings}
    assert {"frames.base": "panda_link0"} in controller.parameters
    assert {"base_frame": "panda_link0"} in guard.parameters


def test_an_arm_of_ones_own_has_its_images_by_the_names_that_every_launch_file_takes() -> None:
    """A D405's colour, as it was, is neither rectified nor on depth's pixels."""
    names = ("own_arm", "cell", "perception")
    launched = [{a.name: a for a in declared_arguments(ROOT / f"seed_bringup/launch/{n}_launch.xml")} for n in names]
    for argument in ("brightness", "left_bubble", "right_bubble"):
        assert len({given[argument].default for given in launched}) == 1, argument


@pytest.mark.parametrize("argument", ["links", "use_sim_time"])
@pytest.mark.parametrize("file", ["cell", "demo", "perception"])
def test_what_is_neither_true_nor_false_is_refused_before_anything_starts(file: str, argument: str) -> None:
    """`ros2 launch` would find it at the node that asks, when others run already; choices it checks at once."""
    path = ROOT / f"seed_bringup/launch/{file}_launch.xml"
    declared = {a.name: a for a in declared_arguments(path)}
    if argument not in declared:
        return
    assert {*declared[argument].choices} == {"true", "false", "True", "False"}
    with pytest.raises(LaunchError, match="must be one of"):
        describe(path, {argument: "perhaps"})


@pytest.mark.parametrize("word", ["true", "True"])
def test_a_driver_behind_simulated_time_is_told_so(word: str) -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    arguments = {"robot": "ur", "robot_ip": "127.0.0.2", "use_sim_time": word}
    (driver,) = [
        n for n in describe(ROOT / "seed_bringup/launch/cell_launch.xml", arguments).nodes if n.name == "driver"
    ]
    assert {"simulated": True} in driver.parameters
    assert {"use_sim_time": True} in driver.parameters


def cell_driver() -> DriverConfig:
    return DriverConfig(
        **yaml.safe_load((ROOT / "seed_bringup/config/driver.yaml").read_text())["/**"]["ros__parameters"]
    )


@pytest.mark.parametrize("driver", [cell_driver(), GuardConfig()], ids=["driver", "target guard"])
def test_what_is_below_the_controller_does_not_clip_its_commands(driver: DriverConfig | GuardConfig) -> None:
    """An arm that trails its command by more the larger the motion makes the wipe swing."""
    controller, lever = ControllerParameters(), 0.15  # [m] from flange to gripper
    assert COMMANDED * driver.max_angular_speed > controller.max_angular_speed
    assert COMMANDED * driver.max_speed > controller.max_speed + lever * controller.max_angular_speed
    assert driver.max_angular_acceleration > controller.max_angular_acceleration
    assert driver.max_acceleration > controller.max_acceleration + lever * controller.max_angular_acceleration
    assert driver.max_jerk > controller.max_jerk + lever * controller.max_angular_jerk


def test_a_cell_that_is_told_nothing_believes_what_the_simulated_one_is() -> None:
    """Cameras a centimetre beside where they are believed to be see two tools."""
    told = yaml.safe_load((ROOT / "seed_bringup/config/hand.yaml").read_text())
    assert told == beliefs(load_scenario("nominal"))


def test_the_hand_files_are_those_of_the_shipped_scenarios() -> None:
    """To make one anew: ./seed hand NAME > seed_bringup/config/hands/NAME.yaml."""
    there = {f.stem: f.read_text() for f in (ROOT / "seed_bringup/config/hands").glob("*.yaml")}
    assert there == {name: hand_file_of(load_scenario(name)) for name in shipped_scenarios()}


@pytest.mark.parametrize(
    ("arguments", "tool"),
    [
        ({}, "squeegee"),
        ({"scenario": "pen"}, "pen"),
        ({"scenario": "peg", "robot": "ur", "robot_ip": "127.0.0.2"}, "peg"),
        ({"scenario": "pen", "robot": "ur", "robot_ip": "192.168.56.101"}, "squeegee"),
        ({"scenario": "pen", "hand_file": str(ROOT / "seed_bringup/config/hand.yaml")}, "squeegee"),
    ],
)
def test_every_node_is_told_of_the_tool_that_the_simulated_gripper_holds(arguments: dict[str, str], tool: str) -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    nodes = {n.name: n for n in describe(ROOT / "seed_bringup/launch/cell_launch.xml", arguments).nodes}
    files = [p for name in ("controller", "estimator") for p in nodes[name].parameters if isinstance(p, Path)]
    hands = {f for f in files if "hand" in f.parts[-1] or "hands" in f.parts}
    hands |= {
        Path(p["hand_file"]) for n in nodes.values() for p in n.parameters if isinstance(p, dict) and "hand_file" in p
    }
    (hand,) = hands
    assert read_hand(str(hand))[1].name == tool


def seed_launch(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "seed_bringup.commands.dispatch", "launch", "cell", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0)


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("scenario=pen", "scenario=pen: write scenario:=pen"),
        ("scenario:=penn", "did you mean pen?"),
        ("task:=squeege", "did you mean squeegee?"),
        ("base:=", "base:= has no name"),
        ("robot:=ur", "robot:=ur needs robot_ip:=ADDRESS"),
        ("task:=triangel.yaml", "no task 'triangel.yaml': no such file in"),
        ("namespace:=9x", "'9x' must be names with / between them"),
        (f"hand_file:={__file__}", f"hand_file: {__file__}: not YAML"),
        (f"controller_file:={ROOT / 'seed_bringup/resource/seed_bringup'}", "no file of parameters"),
    ],
)
def test_a_mistake_in_an_argument_is_told_once_before_any_node_starts(word: str, told: str) -> None:
    done = seed_launch(word)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert told in done.stderr


@pytest.mark.parametrize(
    ("file", "words", "refused", "unused"),
    [
        ("cell", "robot:=none method:=truth", "method:=truth with robot:=none: only a simulation knows", ""),
        ("cell", "fingers:=left method:=published", "fingers:=left with method:=published: that one needs both", ""),
        ("perception", "fingers:=left method:=published", "fingers:=left with method:=published: that one", ""),
        ("own_arm", "base:=", "base:= has no name", ""),
        ("cell", "robot:=ur", "robot:=ur needs robot_ip:=ADDRESS of the UR controller", ""),
        ("robot_host", "address:=127.0.0.1 peers:=192.0.2.2 robot:=ur robot_ip:=", "robot:=ur needs robot_ip:=", ""),
        ("demo", "robot:=ur", "robot:=ur needs robot_ip:=ADDRESS", ""),
        ("cell", "robot:=ur robot_ip:=127.example.com", "robot:=ur robot_ip:=127.example.com is no address", ""),
        ("cell", "method:=truth cameras:=realsense", "", "cameras:=realsense with method:=truth: no camera is started"),
        ("cell", "cameras:=realsense", "", "cameras:=realsense with robot:=sim: its bubbles are simulated"),
        ("cell", "clocks:=/nope.yaml", "", "clocks:=/nope.yaml with robot:=sim: a simulated cell has one clock"),
        ("cell", "robot:=none scenario:=pen", "", "scenario:=pen with robot:=none: it is of the simulated cell"),
        ("cell", "robot:=ur robot_ip:=192.0.2.1 seed:=3", "", "seed:=3 with robot:=ur robot_ip:=192.0.2.1: it is of"),
        ("own_arm", "task:=pen", "", "task:=pen with robot:=none: it is of the simulated cell"),
        ("cell", "fingers:=left", "", ""),
        ("cell", "robot:=ur robot_ip:=127.0.0.2 scenario:=pen method:=truth clocks:=one", "", ""),
        ("cell", "robot:=ur robot_ip:=192.0.2.1 cameras:=realsense clocks:=one", "", ""),
        ("cell", "robot:=none cameras:=realsense base:=panda_link0", "", ""),
        ("perception", "cameras:=realsense", "", ""),
        ("own_arm", "base:=panda_link0", "", ""),
        ("demo", "scenario:=pen seed:=1", "", ""),
    ],
)
def test_arguments_that_contradict_each_other_are_named(file: str, words: str, refused: str, unused: str) -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    own = str(ROOT / "seed_bringup/config/hand.yaml")  # its folder's name may have spaces
    given = dict(word.replace("HAND", own).split(":=") for word in words.split())
    variables = describe(ROOT / f"seed_bringup/launch/{file}_launch.xml", given).variables
    if refused:
        with pytest.raises(LaunchError, match=f"^{re.escape(refused)}"):
            contradictions(given, variables)
        return
    told = contradictions(given, variables)
    assert [line[: len(unused)] for line in told] == ([unused] if unused else [])


@pytest.mark.parametrize(
    ("file", "words", "started", "config"),
    [
        ("cell", "cameras:=realsense", False, "camera_picoflexx"),
        ("cell", "robot:=ur robot_ip:=127.0.0.2 cameras:=realsense", False, "camera_picoflexx"),
        ("cell", "robot:=ur robot_ip:=192.0.2.1 cameras:=realsense", True, "camera_d405"),
        ("cell", "robot:=none cameras:=realsense", True, "camera_d405"),
        ("cell", "robot:=none", False, "camera_picoflexx"),
        ("own_arm", "", False, "camera_d405"),
        ("perception", "", False, "camera_picoflexx"),
        ("perception", "cameras:=realsense", True, "camera_d405"),
        ("perception", "cameras:=realsense camera_file:=HAND", True, "hand"),
    ],
)
def test_cameras_start_where_bubbles_are_real_and_with_a_file_that_is_of_them(
    file: str, words: str, started: bool, config: str
) -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    own = str(ROOT / "seed_bringup/config/hand.yaml")  # its folder's name may have spaces
    given = dict(word.replace("HAND", own).split(":=") for word in words.split())
    nodes = {n.name: n for n in describe(ROOT / f"seed_bringup/launch/{file}_launch.xml", given).nodes}
    assert ("cameras" in nodes) == started
    for name in {"cameras", "estimator"} & nodes.keys():
        files = [p for p in nodes[name].parameters if isinstance(p, Path)]
        assert files[-1].stem == config
        given_files = next(p for p in nodes[name].parameters if isinstance(p, dict) and "parameter_files" in p)
        assert given_files["parameter_files"][-1] == str(files[-1])
    if started and config == "camera_d405":
        assert any(key.endswith("/cameras") for key in yaml.safe_load(files[-1].read_text()))


def test_a_scenario_of_ones_own_comes_with_what_estimator_and_controller_are_told(tmp_path: Path) -> None:
    mine = tmp_path / "roller.yaml"
    mine.write_text("name: roller\ntool: {name: roller, mass: 0.35}\n")
    cell = ROOT / "seed_bringup/launch/cell_launch.xml"
    with checked_arguments(cell, {"scenario": str(mine)}) as arguments:
        _, tool = read_hand(arguments["hand_file"])
        assert (tool.name, tool.mass) == ("roller", 0.35)
        assert compare(load_scenario(mine), arguments["hand_file"]) == ""
    with checked_arguments(cell, {"scenario": str(mine), "hand_file": "mine.yaml"}) as arguments:
        assert arguments["hand_file"] == "mine.yaml"
    with checked_arguments(cell, {"scenario": "pen"}) as arguments:
        assert "hand_file" not in arguments  # the launch file has it


def test_a_simulated_cell_refuses_to_be_told_of_another_tool_and_names_other_numbers(tmp_path: Path) -> None:
    pen = load_scenario("pen")
    with pytest.raises(
        SeedError, match=r"'pen' holds a 'pen' of 0.02 kg.*hand.yaml tells the controller of a 'squeegee'"
    ):
        compare(pen, str(ROOT / "seed_bringup/config/hand.yaml"))
    heavy = tmp_path / "heavy.yaml"
    heavy.write_text(hand_file_of(replace(pen, tool=replace(pen.tool, mass=0.03))))
    assert "mass 0.02 kg, told 0.03 kg" in compare(pen, str(heavy))
    assert compare(replace(pen, true_mass=0.025), str(ROOT / "seed_bringup/config/hands/pen.yaml")) == ""  # hidden


def test_the_guard_of_an_arm_of_ones_own_has_its_clock_and_timeout() -> None:
    """With the clock of a simulator it would refuse all targets as old."""
    file = ROOT / "seed_bringup/launch/own_arm_launch.xml"
    nodes = {n.name: n for n in describe(file, {"use_sim_time": "true", "command_timeout": "0.5"}).nodes}
    told = {
        key: value for given in nodes["guard"].parameters if isinstance(given, dict) for key, value in given.items()
    }
    assert (told["use_sim_time"], told["command_timeout"]) == (True, 0.5)
