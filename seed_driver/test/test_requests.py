# SPDX-License-Identifier: Apache-2.0
"""The thread of the driver's services that ask the controller's dashboard or Robot API."""

import subprocess
import sys

PROGRAM = """
import time
from types import SimpleNamespace
from seed_driver.ros.requests import Requests

requests = Requests(SimpleNamespace(serve=lambda *_, **__: None), lambda: 0)
requests.begin(None, "127.0.0.1")
requests._in_thread(lambda _: time.sleep(60.0)).send(None)
time.sleep(0.2)
requests.close()
print("closed", flush=True)
"""


def test_an_answer_that_is_waited_for_does_not_keep_the_driver_from_ending() -> None:
    """That of a Robot API to POWER_ON may take a minute."""
    told = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=30.0)
    assert (told.stdout, told.returncode) == ("closed\n", 0)
