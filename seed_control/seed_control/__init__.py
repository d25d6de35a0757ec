# SPDX-License-Identifier: Apache-2.0
"""Control of a tool through a compliant grasp: Algorithms 1 and 2 of the paper, and hybrid force/pose control.

algorithm2.py   the paper's main algorithm, which every law shares
law/            the laws: published.py (Algorithm 2, hybrid by the partial inverses of Sec. V-C, partial_inverse.py)
                and hybrid.py (the same with what a real arm needs; the default law `seed`)
controller.py   set-points: checks -> law -> flange command (and limiter); images: inputs -> wrench estimate -> law
supervisor.py   what may make it hold: monitor/ (the estimate), command/ (the motion); report.py: what it then tells
setpoint/       what may be asked, and its checks    wrench/   images to wrenches    command/   motion limits
tasks/          YAML files to set-points             payload/  mass of the tool      ros/       the node
"""

from seed_control.algorithm2 import force_control
from seed_control.controller import Controller, ControlRefusedError
from seed_control.parameters import LAWS, ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint, RelativePoseSetpoint, SetpointError, WrenchSetpoint
from seed_control.state import ControllerState, ControlOutput
from seed_control.tasks import Task, TaskPlayer, load_task

__all__ = [
    "LAWS",
    "ControlOutput",
    "ControlRefusedError",
    "Controller",
    "ControllerParameters",
    "ControllerState",
    "HybridSetpoint",
    "RelativePoseSetpoint",
    "SetpointError",
    "Task",
    "TaskPlayer",
    "WrenchSetpoint",
    "force_control",
    "load_task",
]
