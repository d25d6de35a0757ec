# SPDX-License-Identifier: Apache-2.0
"""Launch files, configuration, the launcher, bag tools, the demo and its report.

from seed_bringup import Launch, find_launch_file, recording

with Launch(find_launch_file(["cell"]), {"method": "truth"}), recording("bag.mcap", ["/wrench_estimate"]):
    ...
"""

from seed_bringup.bags.recording import recording
from seed_bringup.launching.launch_xml import LaunchError
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file

__all__ = ["Launch", "LaunchError", "find_launch_file", "recording"]
