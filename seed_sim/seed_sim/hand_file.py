# SPDX-License-Identifier: Apache-2.0
"""./seed hand: what estimator and controller are to be told of a scenario's hand, tool and grasp, as a hand_file.

The files in seed_bringup/config/hands are made by this; a cell with `scenario:=NAME` takes the one of that name.
"""

from typing import Any

import numpy as np
import yaml

from seed_core.config import ConfigError, to_mapping
from seed_core.hand import Tool, read_hand
from seed_core.program.command_line import Parser, command
from seed_sim.scenario import Scenario, load_scenario, shipped_scenarios

SAME = 1e-6  # [kg], [m]


def beliefs(scenario: Scenario) -> dict[str, Any]:
    """What the controller and the estimator believe about hand, tool and grasp, as ROS parameters for all nodes."""
    stiffness = scenario.grasp.believed or scenario.grasp.stiffness
    values = {"hand": scenario.hand, "tool": scenario.tool, "grasp": stiffness}
    return {"/**": {"ros__parameters": {k: to_mapping(v) for k, v in values.items()}}}


def hand_file_of(scenario: Scenario) -> str:
    """The text of a hand_file."""
    head = (
        "# SPDX-License-Identifier: Apache-2.0\n"
        f"# What estimator and controller are told of the scenario '{scenario.name}'; ./seed hand writes it.\n"
    )
    if scenario.grasp.kind == "membrane" and scenario.grasp.believed is None:
        head += "# The grasp's stiffness is that of no membrane: identify it, or say grasp.believed in the scenario.\n"
    return head + yaml.safe_dump(beliefs(scenario), sort_keys=False, default_flow_style=None, width=120)


def compare(scenario: Scenario, file: str) -> str:
    """In what the hand_file of estimator and controller is not so in a simulated scenario; '' for nothing.

    Raises:
        ConfigError: it is of another tool, or cannot be read.
    """
    (hand, tool), true = read_hand(file), scenario.tool
    if tool.name != true.name:
        raise ConfigError(
            f"the scenario '{scenario.name}' holds {_words(true)}, and {file} tells the controller of {_words(tool)}: "
            f"leave hand_file away, or give it what ./seed hand prints of the scenario; or choose another scenario"
        )
    parts = []
    if abs(tool.mass - true.mass) > SAME:
        parts.append(f"mass {true.mass:g} kg, told {tool.mass:g} kg")
    if not np.allclose(tool.X_Ttip, true.X_Ttip, atol=SAME):
        parts.append(f"tip at {true.T_tip.position} m in T, told {tool.T_tip.position} m")
    if not np.allclose(hand.X_EC, scenario.hand.X_EC, atol=SAME):
        parts.append(f"grasp at {scenario.hand.E_C.position} m in the flange, told {hand.E_C.position} m")
    return f"the {true.name} is not what {file} tells the controller: {'; '.join(parts)}" if parts else ""


def _words(tool: Tool) -> str:
    return f"a '{tool.name}' of {tool.mass:g} kg, tip {1e3 * tool.T_tip.position[2]:g} mm from the grasp"


@command("seed hand")
def main(argv: list[str]) -> int:
    """Print it."""
    p = Parser(
        prog="seed hand",
        description="Print the hand_file of a scenario: what estimator and controller are told of its hand, tool and\n"
        "grasp. ./seed launch cell does this by itself; ros2 launch takes hand_file:=FILE.",
    )
    p.add_argument("scenario", help=f"a scenario file, or one of {', '.join(shipped_scenarios())}")
    print(hand_file_of(load_scenario(p.parse_args(argv).scenario)), end="")
    return 0
