# SPDX-License-Identifier: Apache-2.0
"""What SROS 2 lets each node of a cell do, read back from the keystore's own files; and a middleware without it."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from seed_bringup.access import command, keystore
from seed_bringup.access.permissions import allows
from seed_bringup.access.policy import read_policy
from seed_bringup.launching.launch_xml import LaunchError
from seed_bringup.launching.launcher import Launch
from seed_core.errors import SeedError

ROOT = Path(__file__).resolve().parents[2]
POLICY = ROOT / "seed_bringup/config/access/cell.policy.xml"
OPERATORS = {"/operator", "/page"}
MOVERS = {"/controller", "/sysid"}  # that send an arm anywhere
NODES = {
    "/estimator",
    "/driver",
    "/guard",
    "/gripper_action",
    "/sim",
    "/bubbles",
    "/cameras",
    "/identification_cell",
    "/link_frames",
    "/page",
    "/viewer",
} | MOVERS
needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the keys")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("access") / "keys"
    assert command.main([str(folder), "--policy", str(POLICY)]) == 0
    return folder


def may(store: Path, enclave: str, does: str, topic: str) -> bool:
    text = (store / "enclaves" / enclave[1:] / "permissions.xml").read_text(encoding="utf-8")
    return allows(text, does, topic, f"CN={enclave}")


def enclaves(store: Path) -> set[str]:
    return {f"/{f.name}" for f in (store / "enclaves").iterdir() if f.is_dir()}


def openssl(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["openssl", *map(str, words)], capture_output=True, text=True, check=False)


@needs_openssl
def test_only_who_moves_arms_publishes_target_frame_and_only_an_operator_enables(store: Path) -> None:
    assert enclaves(store) >= NODES | {"/operator"}
    for enclave in enclaves(store):
        assert may(store, enclave, "publish", "rt/target_frame") is (enclave in MOVERS)
        assert may(store, enclave, "publish", "rq/controller/enableRequest") is (enclave in OPERATORS)
        assert may(store, enclave, "publish", "rq/driver/resend_robot_programRequest") is (enclave in OPERATORS)
        for part in ("send_goal", "cancel_goal"):
            asks = f"rq/controller/follow_setpoints/_action/{part}Request"
            assert may(store, enclave, "publish", asks) is (enclave in OPERATORS)
        assert may(store, enclave, "publish", "rt/controller/setpoint") is (enclave == "/operator")
        assert not may(store, enclave, "publish", "rq/controller/set_parametersRequest")
        assert may(store, enclave, "publish", "rt/relative_pose") is (
            enclave in {"/estimator", "/sim", "/identification_cell"}
        )


@needs_openssl
def test_each_node_may_do_what_it_needs(store: Path) -> None:
    for topic in ("rt/target_frame", "rr/controller/enableReply", "rt/controller/follow_setpoints/_action/feedback"):
        assert may(store, "/controller", "publish", topic)
    for topic in ("rt/relative_pose", "rt/driver/hold_reason", "rq/controller/enableRequest", "rt/clock_answer"):
        assert may(store, "/controller", "subscribe", topic)
    assert may(store, "/controller", "subscribe", "rt/wrench")  # arm_wrench:=wrench of the launch
    assert may(store, "/driver", "subscribe", "rt/target_frame")
    assert may(store, "/operator", "subscribe", "rr/controller/enableReply")
    assert all(may(store, e, does, "ros_discovery_info") for e in enclaves(store) for does in ("publish", "subscribe"))


def test_a_subject_of_another_name_and_a_topic_of_none_are_denied() -> None:
    grant = "<grant><subject_name>CN=/a</subject_name>{}<default>DENY</default></grant>"
    rule = "<{0}><publish><topics><topic>rt/{1}</topic></topics></publish></{0}>"
    rules = rule.format("deny_rule", "secret") + rule.format("allow_rule", "*")
    text = f"<dds><permissions>{grant.format(rules)}</permissions></dds>"
    assert allows(text, "publish", "rt/open", "CN=/a")
    assert not allows(text, "publish", "rt/secret", "CN=/a")
    assert not allows(text, "subscribe", "rt/open", "CN=/a")
    assert not allows(text, "publish", "rt/open", "CN=/b")


@needs_openssl
def test_identities_and_permissions_are_signed_and_what_was_changed_is_noticed(store: Path, tmp_path: Path) -> None:
    authority = store / "public/ca.cert.pem"
    for enclave in enclaves(store):
        place = store / "enclaves" / enclave[1:]
        assert openssl("verify", "-CAfile", authority, place / "cert.pem").returncode == 0
        subject = openssl("x509", "-in", place / "cert.pem", "-noout", "-subject", "-nameopt", "RFC2253").stdout
        assert subject.strip() == f"subject=CN={enclave}"
        for signed in ("permissions.p7s", "governance.p7s"):
            assert openssl("smime", "-verify", "-in", place / signed, "-CAfile", authority).returncode == 0
        assert stat.S_IMODE((place / "key.pem").stat().st_mode) == 0o600
    forged = tmp_path / "permissions.p7s"
    honest = (store / "enclaves/viewer/permissions.p7s").read_text(encoding="utf-8")
    forged.write_text(honest.replace("rt/rosout", "rt/target_frame"), encoding="utf-8")
    assert openssl("smime", "-verify", "-in", forged, "-CAfile", authority).returncode != 0
    rules = ElementTree.parse(store / "enclaves/governance.xml").getroot()
    assert rules.findtext(".//allow_unauthenticated_participants") == "false"
    assert rules.findtext(".//enable_write_access_control") == "true"


@needs_openssl
def test_made_again_it_keeps_its_keys_and_a_namespace_is_in_the_names(store: Path, tmp_path: Path) -> None:
    key = (store / "enclaves/controller/key.pem").read_bytes()
    assert command.main([str(store), "--policy", str(POLICY)]) == 0
    assert (store / "enclaves/controller/key.pem").read_bytes() == key
    left = tmp_path / "left"
    only = tmp_path / "two.policy.xml"
    root = ElementTree.parse(POLICY)
    whole = root.getroot().find("enclaves")
    assert whole is not None
    for enclave in [e for e in whole if e.get("path") != "/controller"]:
        whole.remove(enclave)
    root.write(only)
    assert command.main([str(left), "--policy", str(only), "--namespace", "left"]) == 0
    assert may(left, "/controller", "publish", "rt/left/target_frame")
    assert may(left, "/controller", "publish", "rt/diagnostics")
    assert not may(left, "/controller", "publish", "rt/target_frame")


@needs_openssl
def test_a_second_cell_does_not_take_the_rights_of_the_first(tmp_path: Path, capsys) -> None:
    folder = tmp_path / "keys"
    small = tmp_path / "small.policy.xml"
    rights = "<topics publish='ALLOW'><topic>/target_frame</topic></topics>"
    small.write_text(f"<policy version='0.2.0'><enclave path='/controller'>{rights}</enclave></policy>")
    words = [str(folder), "--policy", str(small), "--namespace"]
    assert command.main([*words, "left"]) == 0
    assert command.main([*words, "right"]) != 0
    assert "has the keys of the cell in namespace 'left': name another folder" in capsys.readouterr().err
    assert command.main(words[:-1]) != 0
    assert may(folder, "/controller", "publish", "rt/left/target_frame")
    assert not may(folder, "/controller", "publish", "rt/right/target_frame")
    assert command.main([*words, "left"]) == 0


@needs_openssl
@pytest.mark.parametrize("lost", ["enclaves/controller/cert.pem", "enclaves/controller/key.pem", "public/ca.cert.pem"])
def test_what_an_interruption_left_undone_is_done_by_the_next_call(store: Path, tmp_path: Path, lost: str) -> None:
    copy = shutil.copytree(store, tmp_path / "copy", symlinks=True)
    (copy / lost).unlink()
    assert command.main([str(copy), "--policy", str(POLICY)]) == 0
    for enclave in enclaves(copy):
        place = copy / "enclaves" / enclave[1:]
        assert openssl("verify", "-CAfile", copy / "public/ca.cert.pem", place / "cert.pem").returncode == 0
        keys = [
            openssl(*words, "-pubout" if words[0] == "pkey" else "-pubkey").stdout
            for words in (("pkey", "-in", place / "key.pem"), ("x509", "-noout", "-in", place / "cert.pem"))
        ]
        assert keys[0] == keys[1] != ""


@needs_openssl
@pytest.mark.parametrize("during", [1, 2, 3])
def test_openssl_that_is_interrupted_leaves_no_key_without_its_certificate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, during: int
) -> None:
    whole, calls = keystore._openssl, []

    def interrupted(*words: str) -> None:
        calls.append(words[0])
        whole(*words)
        if len([c for c in calls if c != "smime"]) == during:
            raise KeyboardInterrupt  # after the key was written, before what comes next

    rights = dict(list(read_policy(POLICY).items())[:1])
    with monkeypatch.context() as patch:
        patch.setattr(keystore, "_openssl", interrupted)
        with pytest.raises(KeyboardInterrupt):
            keystore.make_keystore(tmp_path, rights)
    keystore.make_keystore(tmp_path, rights)
    (place,) = (tmp_path / "enclaves" / path[1:] for path in rights)
    assert openssl("verify", "-CAfile", tmp_path / "public/ca.cert.pem", place / "cert.pem").returncode == 0


@needs_openssl
def test_without_the_authoritys_key_no_new_authority_takes_its_place(store: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(store, tmp_path / "copy", symlinks=True)
    shutil.rmtree(copy / "private")
    assert command.main([str(copy), "--policy", str(POLICY)]) != 0
    assert (copy / "public/ca.cert.pem").read_bytes() == (store / "public/ca.cert.pem").read_bytes()


def test_launch_files_give_each_node_its_enclave() -> None:
    known = set(read_policy(POLICY))
    files = list(ROOT.glob("seed_*/launch/**/*.xml"))
    assert files
    for file in files:
        for node in ElementTree.parse(file).getroot().iter("node"):
            name = f"/{node.get('name')}"
            given = [e.get("value") for e in node.iter("env") if e.get("name") == "ROS_SECURITY_ENCLAVE_OVERRIDE"]
            assert given == ([name] if name in known else []), f"{file}: {name}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nothing", "no policy can be read"),
        ("<policy version='0.1.0'/>", "must be <policy version='0.2.0'>"),
        ("<policy version='0.2.0'><enclave path='a'/></policy>", "enclave path 'a' must begin with /"),
        (
            "<policy version='0.2.0'><enclave path='/a'><topics publish='DENY'/></enclave></policy>",
            "publish='DENY': only ALLOW is taken",
        ),
        (
            "<policy version='0.2.0'><enclave path='/a'><topics publish='ALLOW'><topic>b</topic></topics>"
            "</enclave></policy>",
            "'b' must be an absolute name",
        ),
    ],
)
def test_a_file_that_is_no_policy_is_refused(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "mine.xml"
    file.write_text(text)
    with pytest.raises(SeedError, match=words):
        read_policy(file)


@needs_openssl
@pytest.mark.ros
def test_a_middleware_without_security_is_told_in_one_sentence(store: Path) -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    node = "from seed_bringup.ros.link_frames import main; raise SystemExit(main())"
    secured = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}

    def started(**more: str) -> subprocess.CompletedProcess[str]:
        environment = os.environ | secured | more
        return subprocess.run(
            [sys.executable, "-c", node], env=environment, capture_output=True, text=True, timeout=60, check=False
        )

    unknown = started()
    assert unknown.returncode == 1
    assert "make one with ./seed access FOLDER" in unknown.stderr
    if os.environ.get("SEED_ROS") != "wheels":
        pytest.skip("this middleware may have its security libraries: the node would run")
    refused = started(ROS_SECURITY_KEYSTORE=str(store), ROS_SECURITY_ENCLAVE_OVERRIDE="/link_frames")
    assert refused.returncode == 1
    assert "built without its security libraries" in refused.stderr
    assert "Traceback" not in unknown.stderr + refused.stderr


def test_a_launch_on_wheels_is_refused_before_anything_starts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "nothing_launch.xml"
    file.write_text("<launch/>")
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("SEED_ROS", "wheels")
    with pytest.raises(LaunchError, match="built without its security libraries"):
        Launch(file).start()
    monkeypatch.setenv("SEED_ROS", "/opt/ros/jazzy")
    with Launch(file) as launch:
        assert launch.poll() == 0
