# SPDX-License-Identifier: Apache-2.0
"""Launch files, configuration, the launcher, bag tools, the demo and its report.

from seed_bringup import Launch, Recording, find_launch_file

with Launch(find_launch_file(["cell"]), {"method": "truth"}), Recording("bag.mcap", ["/wrench_estimate"]):
    ...
"""

from seed_bringup.bags.recording import Recording
from seed_bringup.launching.launch_xml import LaunchError
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file

__all__ = ["Launch", "LaunchError", "Recording", "find_launch_file"]
