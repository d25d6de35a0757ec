# SPDX-License-Identifier: Apache-2.0
"""Bags and evaluations as a LeRobot dataset: `./seed dataset`.

command.py          the command
episode.py          what an episode holds, as plain arrays; its fields and their names
evaluations.py      episodes of the closed loop without ROS
episodes_bag.py     episodes of a bag
following.py        when a set-point of a bag is followed
environment.py      the environment of LeRobot, beside that of the suite, which has no torch
lerobot_writer.py   runs in that environment: from plain arrays to the dataset
"""
