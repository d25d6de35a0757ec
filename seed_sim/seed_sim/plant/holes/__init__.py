# SPDX-License-Identifier: Apache-2.0
"""A plate with a hole, and the peg or plug that goes into it: penalty contact with Coulomb friction that sticks.

parameters.py  what a scenario says of them
section.py     a cross-section, round or rectangular: distance to its outline, and points along it
edges.py       how deep a point lies in what such a section, a face and a chamfer bound
friction.py    what each touching point bears across its normal
contact.py     all of it as one load on the tool
score.py       how deep, how long, and what was borne in a run
"""
