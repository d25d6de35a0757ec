# SPDX-License-Identifier: Apache-2.0
"""Parameters of the grip that answers slip. A grip force is that of one finger, normal to its patch."""

from dataclasses import dataclass

from seed_core.config import ConfigError, field


@dataclass(frozen=True)
class GripSettings:
    """Off until `command` allows it; friction and patch_radius are to be measured first, see docs/grip.md."""

    command: str = field(
        "off", choices=("off", "width", "force"), doc="what the gripper is sent: nothing, gripper/command or "
        "gripper/force_command"
    )  # fmt: skip
    margin: float = field(0.2, low=0.05, high=0.9, doc="slip margin to keep: the share of friction left unused")
    friction: float = field(0.8, low=0.05, high=5.0, doc="Coulomb's coefficient between membrane and tool, at first")
    friction_deviation: float = field(0.1, low=0.0, high=1.0, doc="its relative standard deviation")
    patch_radius: float = field(
        0.010, unit="m", low=0.001, high=0.1, doc="torque about the fingers' axis that slides, over force that slides"
    )
    least_force: float = field(2.0, unit="N", low=0.0, high=500.0, doc="it relaxes to no less")
    max_force: float = field(
        15.0, unit="N", low=0.1, high=500.0, doc="the least of what gripper, membranes and tool bear"
    )
    min_width: float = field(0.0, unit="m", low=0.0, high=0.5, doc="it closes no further: the membranes' limit")
    max_width: float = field(0.1, unit="m", low=0.0, high=0.5, doc="it opens no further")
    force_per_width: float = field(
        800.0, unit="N/m", low=10.0, high=1e5, doc="rise of the grip force per closed metre, for commands of width"
    )
    latency: float = field(
        0.03, unit="s", low=0.0, high=0.5, doc="from a command to the grip it makes: loads are foretold so far"
    )
    load_kept: bool = field(
        True,
        doc="a grip that tightens adds no load to a stiffness map's (membranes); false: a spring that scales with it",
    )
    relax_after: float = field(0.5, unit="s", low=0.0, high=60.0, doc="without need of more grip, before it relaxes")
    relax_rate: float = field(0.5, unit="1/s", low=0.0, high=10.0, doc="share of the grip it gives up per second")
    answer_time: float = field(
        0.4, unit="s", low=0.02, high=5.0, doc="in which the gripper has to be heard, and to get near a command"
    )

    def __post_init__(self) -> None:
        if self.least_force > self.max_force:
            raise ConfigError(f"least_force = {self.least_force:g} N must be at most max_force = {self.max_force:g} N")
        if self.min_width > self.max_width:
            raise ConfigError(f"min_width = {self.min_width:g} m must be at most max_width = {self.max_width:g} m")
