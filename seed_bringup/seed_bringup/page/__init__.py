# SPDX-License-Identifier: Apache-2.0
"""The operator page: a cell in a browser, to look at and to run it from.

state.py    what the page shows of one moment, and how force and torque went until then
words.py    that state, and what to do about a hold, in words
scene.py    the 3-D view
plots.py    force and torque, wanted and measured, over time
panel.py    buttons and words; server.py the web server, on loopback; slow_browser.py a script for browsers that draw in
            software
browser.py  a browser without a screen, visitor.py a page without a browser: for tests, pictures and long runs
ros/        the node that listens, what the buttons do, and bags
"""
