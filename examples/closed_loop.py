# SPDX-License-Identifier: Apache-2.0
"""The closed loop in simulation: a squeegee is pressed onto a table with 10 N and wiped (Fig. 6 of the paper).

No ROS, no clock: arm, grasp, tool, table, estimator and controller run faster than real time, and every run of a seed
is the same. Needs the simulator and Matplotlib:

    pip install ./seed_{core,ur,estimation,control,sysid,sim} matplotlib
    python examples/closed_loop.py wipe.png
"""

import sys

import matplotlib

from seed_sim import evaluate

matplotlib.use("Agg")  # a file, no window
import matplotlib.pyplot as plt

FILE = sys.argv[1] if len(sys.argv) > 1 else "closed_loop.png"

# estimator="noisy": poses with the noise and delay of tactile images. "rigid_fit" renders and evaluates the images
# themselves (slower), "truth" is exact.
run = evaluate("squeegee", law="seed", estimator="noisy", seed=7)

score = run.result["force_z"]
print(f"{run.result['task']}: {run.result['message']}")
print(f"force along z: {score['mean']:.2f} N on average, error {score['rmse']:.3f} N rms")

# The recording holds one row per control step, from the plant, not from estimates.
t, force, wanted = (run.recording[name] for name in ("t", "force", "wanted_force"))
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(t, force[:, 2], label="of the tool on the table")
axes.plot(t, wanted[:, 2], "--", label="wanted")
axes.set(xlabel="time [s]", ylabel="force along z [N]", title="Wiping with a squeegee")
axes.legend()
figure.savefig(FILE, dpi=150)
print(f"plot in {FILE}")
