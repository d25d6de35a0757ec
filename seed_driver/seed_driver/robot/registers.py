# SPDX-License-Identifier: Apache-2.0
"""Which of the controller's RTDE registers the driver and its program talk through.

UR's RTDE guide gives 0 to 23 to fieldbus and PLC interfaces and keeps 24 to 47 for external clients. ur_rtde 1.6.5
uses the upper ones from PolyScope 3.9 and 5.3 on; from 5.23 and 10.9 on it writes to the lower ones in any case.
"""

from seed_driver.robot.link import LinkError
from seed_ur.rtde import Version

UPPER = 24  # number of the first upper register


def offset(wanted: str, version: Version) -> int:
    """Number of the first register to use, for the setting `registers`; raises LinkError when that cannot be had."""
    line, release = version[0], version[:2]
    possible = (3, 9) <= release < (4, 0) or (5, 3) <= release < (5, 23)
    if wanted == "upper" and not possible:
        raise LinkError(
            f"ur_rtde 1.6.5 cannot use the upper RTDE registers of PolyScope {line}.{version[1]}: "
            "set registers to auto or lower, and keep 0 to 23 free of fieldbus and PLC"
        )
    return UPPER if possible and wanted != "lower" else 0


def command(first: int) -> str:
    """Name of the register that tells the program what to do."""
    return f"input_int_register_{first}"
