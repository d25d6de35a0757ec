# SPDX-License-Identifier: Apache-2.0
"""A task of one's own: a text with units, checked line by line, and played in simulation without ROS.

On the robot the same text, in a file, is played by `./seed play FILE`. Needs the simulator:
    pip install ./seed_{core,ur,estimation,control,sysid,sim}
"""

from seed_control.tasks import Task
from seed_core import ConfigError
from seed_core.config import load_text
from seed_sim import evaluate

TASK = """
name: polish
description: press a blade onto a table with 6 N and push it 20 cm
tool: squeegee
frame: {position: 0.45 0.0 0.0 m, rpy: 0 0 0 deg}  # the work frame in the world; z points out of the table
tip_rpy: 180 0 0 deg                               # the tool's z points into the table
lift: 0.05 m
phases:
  - name: approach
    to: 0 0 0.015 m
    speed: 0.1 m/s
  - name: press
    to: 0.01 0 0 m
    speed: 0.015 m/s
    control: &pressing
      force: 0 0 -6 N          # of the tool on the table, in the work frame
      force_directions: [z]    # everything else follows the path
      torque: 0 0 0 N m
      torque_axes: [x]         # equal pressure on both sides of the blade
      contact_resists: [x]
    until: settled
  - name: wipe
    to: 0.21 0 0 m
    speed: 0.05 m/s
    control: *pressing
  - name: lift
    to: 0.21 0 0.05 m
    speed: 0.05 m/s
"""

# Whatever is wrong is told with its line: a unit that was forgotten, a force in a direction that is not controlled.
try:
    load_text(TASK.replace("0.015 m/s", "0.015"), Task, "polish.yaml")
except ConfigError as error:
    print(f"refused: {error}")

task = load_text(TASK, Task, "polish.yaml")
result = evaluate(task, scenario="nominal", estimator="noisy", seed=3).result
print(f"{task.name}: {result['message']}; force {result['force_z']['mean']:.2f} N, wanted -6 N")
