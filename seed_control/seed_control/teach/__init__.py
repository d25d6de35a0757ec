# SPDX-License-Identifier: Apache-2.0
"""From a demonstration, led by hand or played, to a task that plays again. docs/teach.md tells how."""

from seed_control.teach.demonstration import Demonstration, Recorder, TeachError
from seed_control.teach.make import TaughtTask, make_task
from seed_control.teach.settings import TeachSettings
from seed_control.teach.write import task_text

__all__ = ["Demonstration", "Recorder", "TeachError", "TeachSettings", "TaughtTask", "task_text", "make_task"]
