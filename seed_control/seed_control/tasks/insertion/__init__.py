# SPDX-License-Identifier: Apache-2.0
"""Finding a hole and going into it: the steps `search` and `insert` of a task.

sections.py  what a task file says of them
plate.py     the plate under the tip, found while it slides, and how far the tip has dropped below it
search.py    a pattern under a press until the tip drops or a rim is felt
stuck.py     progress along the axis; what a wrench without progress means
insert.py    pushing in, with jams and wedges answered
"""
