# SPDX-License-Identifier: Apache-2.0
"""Permissions and governance as DDS Security 1.1 has them: XML from rights, and what such XML allows."""

from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from fnmatch import fnmatchcase
from xml.etree import ElementTree

from seed_bringup.access.policy import Right

YEARS = 10
DOMAINS = (0, 232)
ACTION = ("send_goal", "cancel_goal", "get_result")
SCHEMA = "http://www.omg.org/spec/DDS-SECURITY/20170901"
ENTITIES = ("ros_discovery_info",)  # by which ROS nodes find each other; no name of ROS


def dds_topics(right: Right) -> tuple[set[str], set[str]]:
    """The DDS topics that a right publishes, and those that it subscribes to."""
    name = right.name[1:]
    services, topics = [name], []
    if right.does in ("execute", "call"):
        services = [f"{name}/_action/{part}" for part in ACTION]
        topics = [f"rt/{name}/_action/{part}" for part in ("feedback", "status")]
    requests, replies = {f"rq/{s}Request" for s in services}, {f"rr/{s}Reply" for s in services}
    match right.does:
        case "publish":
            return {f"rt/{name}"}, set()
        case "subscribe":
            return set(), {f"rt/{name}"}
        case "reply" | "execute":
            return replies | set(topics), requests
    return requests, replies | set(topics)


def permissions(enclave: str, rights: Iterable[Right], now: datetime) -> str:
    """permissions.xml of an enclave: what it may publish and subscribe to; all else is denied."""
    publishes, subscribes = set(ENTITIES), set(ENTITIES)
    for right in rights:
        out, into = dds_topics(right)
        publishes |= out
        subscribes |= into
    dds = ElementTree.Element("dds", {"xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance"})
    dds.set("xsi:noNamespaceSchemaLocation", f"{SCHEMA}/omg_shared_ca_permissions.xsd")
    grant = ElementTree.SubElement(ElementTree.SubElement(dds, "permissions"), "grant", {"name": enclave})
    _text(grant, "subject_name", f"CN={enclave}")
    validity = ElementTree.SubElement(grant, "validity")
    _text(validity, "not_before", f"{now - timedelta(days=1):%Y-%m-%dT%H:%M:%S}")
    _text(validity, "not_after", f"{now + timedelta(days=365 * YEARS):%Y-%m-%dT%H:%M:%S}")
    rule = ElementTree.SubElement(grant, "allow_rule")
    _domains(rule)
    for what, names in (("publish", publishes), ("subscribe", subscribes)):
        topics = ElementTree.SubElement(ElementTree.SubElement(rule, what), "topics")
        for name in sorted(names):
            _text(topics, "topic", name)
    _text(grant, "default", "DENY")
    return _xml(dds)


def governance() -> str:
    """governance.xml: every participant is known, everything is checked, signed and encrypted."""
    dds = ElementTree.Element("dds", {"xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance"})
    dds.set("xsi:noNamespaceSchemaLocation", f"{SCHEMA}/omg_shared_ca_governance.xsd")
    rules = ElementTree.SubElement(dds, "domain_access_rules")
    rule = ElementTree.SubElement(rules, "domain_rule")
    _domains(rule)
    for name, value in (
        ("allow_unauthenticated_participants", "false"),
        ("enable_join_access_control", "true"),
        ("discovery_protection_kind", "ENCRYPT"),
        ("liveliness_protection_kind", "ENCRYPT"),
        ("rtps_protection_kind", "SIGN"),
    ):
        _text(rule, name, value)
    topic = ElementTree.SubElement(ElementTree.SubElement(rule, "topic_access_rules"), "topic_rule")
    for name, value in (
        ("topic_expression", "*"),
        ("enable_discovery_protection", "true"),
        ("enable_liveliness_protection", "true"),
        ("enable_read_access_control", "true"),
        ("enable_write_access_control", "true"),
        ("metadata_protection_kind", "ENCRYPT"),
        ("data_protection_kind", "ENCRYPT"),
    ):
        _text(topic, name, value)
    return _xml(dds)


def allows(xml: str, does: str, topic: str, subject: str) -> bool:
    """Whether permissions.xml lets a subject ('CN=/NAME') 'publish' or 'subscribe' to a DDS topic.

    The first rule that names the topic decides, then the default (DDS Security 1.1, 9.4.1.3.2).
    """
    for grant in ElementTree.fromstring(xml).iter("grant"):
        if grant.findtext("subject_name") != subject:
            continue
        for rule in grant:
            if rule.tag not in ("allow_rule", "deny_rule"):
                continue
            names = (t.text or "" for part in rule.findall(does) for t in part.iter("topic"))
            if any(fnmatchcase(topic, name) for name in names):
                return rule.tag == "allow_rule"
        return grant.findtext("default") == "ALLOW"
    return False


def _domains(parent: ElementTree.Element) -> None:
    span = ElementTree.SubElement(ElementTree.SubElement(parent, "domains"), "id_range")
    _text(span, "min", str(DOMAINS[0]))
    _text(span, "max", str(DOMAINS[1]))


def _text(parent: ElementTree.Element, tag: str, text: str) -> None:
    ElementTree.SubElement(parent, tag).text = text


def _xml(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def utc_now() -> datetime:
    """Now."""
    return datetime.now(UTC)
