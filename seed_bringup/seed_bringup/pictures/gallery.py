# SPDX-License-Identifier: Apache-2.0
"""Six small pictures of what the suite can do, each from a run of the closed loop without ROS."""

import cv2
import numpy as np
from matplotlib import style
from matplotlib.figure import Figure

from seed_bringup.demo.figures import BLUE, GREY, INK, STYLE
from seed_bringup.pictures.scene import Scene, bodies, camera_on, drawn, png
from seed_core.hand import Hand
from seed_core.meshes import BUBBLE, WOOD, Mesh, SheetBubble, hand_parts, slab, tool_parts
from seed_core.spatial import pose_from_rpy
from seed_estimation import Estimator, EstimatorParameters
from seed_sim import TactileParameters, TactileRenderer, evaluate
from seed_sim.closed_loop.evaluate import Evaluation
from seed_sim.replay.film import Film, Moment
from seed_sim.replay.fixtures import fixtures, table_mesh
from seed_sim.replay.still import Body, Camera

SIZE = (600, 400)  # [pixels]
SEED = 7
BLOCK = (122, 78, 44)  # colour of what a hole is cut into


def scene_of(run: Evaluation, moment: Moment, film: Film) -> Scene:
    """A moment of a run, with the path of all of it and the force of the table on the tool."""
    plant = run.plant
    tips = np.array([(m.X_WE @ plant.hand.X_EC @ m.X_CT @ plant.tool.X_Ttip)[:3, 3] for m in film.moments])
    pressing = np.array([float(np.linalg.norm(m.wrench.force)) > 0.3 for m in film.moments])
    return Scene(
        plant.hand,
        plant.tool,
        run.plant.scenario.tool_kind,
        moment.X_WE @ plant.hand.X_EC,
        moment.X_CT,
        plant.surface.X_WS,
        tips,
        pressing,
        -moment.wrench.force,
        table=table_mesh(plant.surface),
    )


def at_work(task: str, share: float, distance: float, side: float, cut: bool = False) -> bytes:
    """The cell at that share of a task's time in contact; cut: what stands on the table is cut open."""
    film = Film()
    run = evaluate(task, seed=SEED, film=film)
    touching = [m for m in film.moments if float(np.linalg.norm(m.wrench.force)) > 0.3]
    scene = scene_of(run, touching[int(share * (len(touching) - 1))], film)
    camera = camera_on(scene, SIZE, distance, side)
    return png(drawn(_cut_open(scene, camera) if cut else bodies(scene), camera)[0])


def _cut_open(scene: Scene, camera: Camera) -> list[Body]:
    """Of the walls around a hole those behind the tool, seen from the camera."""
    at = scene.X_WS[:3, 3]
    walls = [w.moved(scene.X_WS) for w in fixtures(scene.kind, scene.tool)]
    behind = [w for w in walls if (w.vertices.mean(axis=0) - at) @ (np.array(camera.eye) - at) < 0.0]
    table = Body(table_mesh().moved(scene.X_WS), WOOD)
    return [*bodies(scene, table=False), table, *(Body(w, BLOCK) for w in behind)]


def wipes() -> bytes:
    """A squeegee wipes a table."""
    return at_work("squeegee", 0.6, 0.9, 0.45)


def fits() -> bytes:
    """A peg in a hole that is cut open."""
    return at_work("peg", 0.9, 0.42, 0.6, cut=True)


def writes() -> bytes:
    """A text on the table, its colour telling the force."""
    run = evaluate("write", seed=SEED)
    r = run.recording
    tip, force = 1e3 * r["tip"], -r["force"][:, 2]
    down = force > 0.3
    with style.context(STYLE):
        figure = Figure(figsize=(6.0, 4.0), dpi=100, layout="constrained")
        axis = figure.subplots()
        wanted = float(np.median(force[down]))
        dots = axis.scatter(
            tip[down, 0], tip[down, 1], c=force[down], s=12, cmap="viridis", vmin=0.8 * wanted, vmax=1.2 * wanted
        )
        figure.colorbar(dots, ax=axis, label="pressing force [N]", shrink=0.6)
        axis.set_aspect("equal")
        axis.set_xlabel("x [mm]")
        axis.set_ylabel("y [mm]")
        return png(figure)


def sees() -> bytes:
    """What the fingers see: the patch in contact and how it has moved."""
    hand = Hand()
    bubbles = TactileRenderer(TactileParameters(), hand, seed=1)
    estimator = Estimator(EstimatorParameters(), hand, bubbles.cameras)
    estimator.capture_reference([bubbles.no_contact(stamp=0.1 * i) for i in range(5)])
    estimator.initialize_grasp([bubbles.render(np.eye(4), stamp=1.0 + 0.1 * i) for i in range(3)])
    for share in np.linspace(0.1, 1.0, 10):
        X_CT = pose_from_rpy(share * np.deg2rad((5.0, 7.0, 2.0)), share * np.array((0.002, 0.0, -0.004)))
        estimator.update(bubbles.render(X_CT, stamp=2.0 + share), stamp=2.0 + share)
    image = estimator.debug_image()
    h, w = image.shape[:2]
    scale = min(SIZE[0] / w, SIZE[1] / h)
    fitted = cv2.resize(image, (round(w * scale), round(h * scale)), interpolation=cv2.INTER_AREA)
    page = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    y = (SIZE[1] - fitted.shape[0]) // 2
    page[y : y + fitted.shape[0], : fitted.shape[1]] = fitted
    return bytes(cv2.imencode(".png", page)[1])


def holds() -> bytes:
    """Force over time: SEED, and the same path with nobody looking at the force."""
    with style.context(STYLE):
        figure = Figure(figsize=(6.0, 4.0), dpi=100, layout="constrained")
        axis = figure.subplots()
        for law, colour, name in (("open_loop", GREY, "open loop"), ("seed", BLUE, "SEED")):
            r = evaluate("squeegee", law=law, seed=SEED).recording
            axis.plot(r["t"], -r["force"][:, 2], color=colour, lw=2.0, label=name)
        axis.axhline(10.0, color=INK, lw=1.0, ls=(0, (4, 3)))
        axis.set_xlabel("time [s]")
        axis.set_ylabel("pressing force [N]")
        axis.legend(loc="center", fontsize=11)
        axis.annotate("wanted", (0.1, 10.0), xytext=(2, 5), textcoords="offset points", color=INK)
        return png(figure)


def deforms() -> bytes:
    """Two simulated membranes on a tool that is pressed into a table; colour tells how they are dented."""
    film = Film()
    run = evaluate("squeegee", seed=SEED, membrane=SEED, film=film)
    hold = run.plant.membranes
    touching = [m for m in film.moments if float(np.linalg.norm(m.wrench.force)) > 0.3] or list(film.moments)
    scene = scene_of(run, touching[len(touching) // 2], film)
    moment = touching[len(touching) // 2]
    assert hold is not None
    X_WC = scene.X_WC
    X_WT = X_WC @ moment.X_CT
    out = [Body(p.mesh.moved(X_WC), p.colour, 0.25) for p in hand_parts(scene.hand) if p.name.endswith("case")]
    out += [Body(p.mesh.moved(X_WT), p.colour) for p in tool_parts(scene.tool, scene.kind)]
    out.append(Body(slab((0.6, 0.5), 0.02, (0.12, 0.0)).moved(scene.X_WS), WOOD))
    for finger, nodes in moment.nodes.items():
        sheet = SheetBubble(hold.state.bubbles[finger].triangles, turn=finger == "right")
        out.append(Body(Mesh(sheet.vertices(nodes), sheet.faces).moved(X_WC), BUBBLE))
    return png(drawn(out, camera_on(scene, SIZE, 0.55, 0.3))[0])
