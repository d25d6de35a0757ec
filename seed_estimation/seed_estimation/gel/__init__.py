# SPDX-License-Identifier: Apache-2.0
"""GelSight-class gels as a sensor: colour and dots of a soft coat, no depth camera.

    shading = calibrated(free, presses, camera, settings)          # shading.py: once per gel, from a ball's presses
    gels = {f: Gel(f, settings, cameras[f], X_CX[f], shading[f]) for f in ("left", "right")}
    estimator = SensorEstimator(gels, SensorEstimatorParameters(), "gel")

Slopes come from the coat's colour by a calibrated map (Yuan, Dong and Adelson, "GelSight: High-Resolution Robot Tactile
Sensors for Estimating Geometry and Force", Sensors 17, 2017), depth from slopes, and the pose from slopes and depth
together as in Huang, Kaess and Yuan, "NormalFlow", RA-L 10, 2025; the dots, which NormalFlow does without, tell the
motion along the gel.
"""
